#!/bin/bash
# Rehearse an installation: a fresh Debian 12, no network, `install.sh --offline`, twice, and what `check` then says.
#
#   rehearse.sh BUNDLE [edge|base] [FOLDER]      as root; needs debootstrap, and the internet once for the Debian root
#
# FOLDER (default /var/tmp/skyfix-rehearsal) keeps the Debian root for the next time.
set -euo pipefail

bundle=${1:?give the bundle: make bundle} role=${2:-edge} folder=${3:-/var/tmp/skyfix-rehearsal}
here=$(cd "$(dirname "$0")" && pwd)
if [ ! -e "$folder/debian/.done" ]; then
    mkdir -p "$folder"
    debootstrap --variant=minbase --include=python3,chrony bookworm "$folder/debian" https://deb.debian.org/debian
    touch "$folder/debian/.done"
fi
rm -rf "$folder/try"
cp -a "$folder/debian" "$folder/try"
cp "$bundle" "$folder/try/root/bundle.tar"
cp "$here/install.sh" "$folder/try/root/"
# No network, no environment, nothing mounted but /proc.
unshare --net --mount --pid --fork env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin bash -euc "
    mount -t proc proc '$folder/try/proc'
    chroot '$folder/try' /root/install.sh '$role' --offline /root/bundle.tar
    echo '--- again'
    chroot '$folder/try' /root/install.sh '$role' --offline /root/bundle.tar
    echo '--- and off'
    chroot '$folder/try' /root/install.sh uninstall --purge
    chroot '$folder/try' test ! -e /opt/skyfix
"
echo "rehearsed: $role"
