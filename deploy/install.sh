#!/bin/bash
# Install Skyfix on Debian 12 or later, or 64-bit Raspberry Pi OS, arm64 or x86-64. Run as root.
#
#   install.sh base [--site NAME --base ADDRESS --cameras N] [--time pps|ntp|none]     makes the parts of its boxes, ./NAME
#   install.sh edge [--from NAME/cam0]     with its part of the site, carried here; or --site NAME --camera ID --base ADDRESS
#   install.sh router
#   install.sh rollback                back to the version before, if it came up then
#   install.sh uninstall [--purge]     --purge also removes configuration and everything recorded
#
# Run it again, from a newer bundle, to upgrade: if a service does not come up, what ran before is put back. This file
# only finds a Python; the rest is the folder `installer` beside it, which says what it changes on the machine.
set -euo pipefail
umask 022

fail() { echo "skyfix: $1; $2" >&2; exit "${3:-1}"; }

here=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
for deploy in "$here" "$here/deploy"; do
    if [ -e "$deploy/installer/__main__.py" ]; then break; fi
done
[ -e "$deploy/installer/__main__.py" ] || fail "the installer is not whole" "unpack the bundle: tar xf skyfix-VERSION-bundle.tar"

# A 64-bit kernel under 32-bit programs says aarch64; no library that Skyfix stands on is made for those any more.
bits=$(getconf LONG_BIT 2>/dev/null || echo 64)
[ "$bits" = 64 ] || fail "this is a $bits-bit system (its kernel says $(uname -m))" "write a 64-bit image to the card; nothing was changed"

found=''
for candidate in python3.11 python3.12 python3.13 python3.14 python3; do
    command -v "$candidate" >/dev/null || continue
    found+=" $("$candidate" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null || echo broken)"
    if "$candidate" -c 'import sys, venv; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
        export PYTHONPATH="$deploy" PYTHONDONTWRITEBYTECODE=1
        exec "$candidate" -s -m installer "$@"
    fi
done
fail "no Python 3.11 or later (found:${found:- none})" "Debian 12 has it: apt install python3 python3-venv"
