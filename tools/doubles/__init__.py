"""Stand-ins for what is not there: each written once, for benches, the demonstration and tests alike.

- Cameras and what flies: flight (a scene of calib.simulation, and the network handed out for it), faults, hazards,
  survey_network.
- Boxes in this process: tracks, box_messages, feed. A box as a process: box.
- A base as a process: base, late_clock, ports.
- A whole site in namespaces: site, air (a network that loses and delays), truth, impostors, intruder.
- Receivers and their serial lines: receiver, serial_receiver.
- Whoever listens to MAVLink, or forges it: listener, peers, peers_at_base, forger.
- Recordings as they grow: heard, tail.
- The rest of a machine: supervisor, disks, rtsp_camera, browser.
"""
