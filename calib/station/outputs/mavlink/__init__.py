"""What goes out as MAVLink: messages, signing, ports and sockets."""
