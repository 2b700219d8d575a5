#!/bin/bash
# Rehearse an installation: a fresh Debian 12, no network, `install.sh --offline`, twice, and what `check` then says.
#
#   rehearse.sh BUNDLE [edge|base] [FOLDER]      as root; needs debootstrap, and the internet once for the Debian root
#
# FOLDER (default /var/tmp/skyfix-rehearsal) keeps the Debian root for the next time. For a Raspberry Pi's processor on
# another machine set ARCH=arm64; that needs qemu-user-static and takes ten times as long.
set -euo pipefail

bundle=${1:?give the bundle: make bundle} role=${2:-edge} folder=${3:-/var/tmp/skyfix-rehearsal}
arch=${ARCH:-$(dpkg --print-architecture)}
root=$folder/debian-$arch
if [ ! -e "$root/.done" ]; then
    mkdir -p "$folder"
    debootstrap --arch="$arch" --variant=minbase --include=python3,chrony bookworm "$root" https://deb.debian.org/debian
    touch "$root/.done"
fi
rm -rf "$folder/try"
cp -a "$root" "$folder/try"
mkdir "$folder/try/root/bundle"
tar -xf "$bundle" -C "$folder/try/root/bundle" --strip-components=1
# No network, no environment, nothing mounted but /proc.
unshare --net --mount --pid --fork env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin bash -euc "
    mount -t proc proc '$folder/try/proc'
    chroot '$folder/try' /root/bundle/install.sh '$role'
    echo '--- again'
    chroot '$folder/try' /root/bundle/install.sh '$role'
    echo '--- and off'
    chroot '$folder/try' /root/bundle/install.sh uninstall --purge
    chroot '$folder/try' test ! -e /opt/skyfix
"
echo "rehearsed: $role on $arch"
