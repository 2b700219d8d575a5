"""The operator's page, in a process of its own so that no browser can slow the tracker.

process.py     in the station: holds the port, starts the page when somebody looks, feeds it and drops what is too much
wire.py        the packets between the two
live.py        what has been fed, and what a browser gets of it (pure)
steps.py       survey, aim, check, calibrate, go: where we stand and what to do (pure)
words.py       status as HTML: steps, pairs, checks, cameras (pure)
past.py        recordings: which there are, and how it looked at an instant
server.py      NiceGUI around all that; static/ holds the map's script and the style
"""
