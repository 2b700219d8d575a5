"""Debian packages of a camera box, a base station and a router, for machines that are kept by apt.

    python -m tools.debs                        dist/skyfix-{common,box,base,router}_<version>_<architecture>.deb
    python -m tools.debs --machine aarch64      for a Raspberry Pi, from any computer

The same wheels of the same lock as the bundle, slimmed in the same way, each package with its own environment below
/usr/lib. Beside a bundle's installation they refuse: one machine has one way of being upgraded.
"""
