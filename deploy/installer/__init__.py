"""What `install.sh` does once it has found a Python: lays a version beside the one that runs, and changes over.

Standard library only: nothing is installed yet. What it changes on the machine:

    /opt/skyfix/<version>, /opt/skyfix/current, previous   the programs (`programs.py`, `versions.py`)
    /etc/skyfix                                            configuration, where there is none (`configuration.py`)
    /var/lib/skyfix                                        what is measured
    systemd units, the user skyfix, udev names, one sysctl (`machine.py`), chrony's configuration (`site_time.py`)

The hazard is the upgrade in a field that leaves a dead box: so what runs is never touched until what replaces it is
whole, and is put back, and seen to run, if that does not come up (`changeover.py`).
"""
