#!/bin/bash
# Install Skyfix on Debian 12 or later, or Raspberry Pi OS, arm64 or x86-64. Run as root.
#
#   install.sh edge|base|router [--offline BUNDLE] [--base ADDRESS] [--time pps|ntp|none] [--no-start]
#   install.sh rollback                back to the version before
#   install.sh uninstall [--purge]     --purge also removes configuration and everything recorded
#
# Run it again to upgrade: the new version is laid beside the old one, and if its service does not come up the old one
# is put back. Configuration that is there is never touched. What it changes on the machine:
#   /opt/skyfix/<version>, /opt/skyfix/current    the programs
#   /etc/skyfix                                   configuration (templates, where there is none)
#   /var/lib/skyfix                               what is measured
#   systemd units, the user skyfix, udev names, one sysctl, chrony's conf.d/skyfix.conf
set -euo pipefail

readonly PREFIX=/opt/skyfix CONFIG=/etc/skyfix STATE=/var/lib/skyfix
readonly UNITS=/etc/systemd/system
readonly COMES_UP_S=30   # Python, numpy and a model from an SD card take about 15 s on a Raspberry Pi 4

say() { echo "skyfix: $*"; }
fail() { echo "skyfix: $1; $2" >&2; exit "${3:-1}"; }
usage() { sed -n '2,7s/^# \{0,1\}//p' "$0" >&2; exit 2; }
has_systemd() { [ -d /run/systemd/system ]; }

# What the words mean

role='' source='' base_address='' time_source='' start=yes purge=no
while [ $# -gt 0 ]; do
    case $1 in
        edge|base|router|rollback|uninstall) [ -z "$role" ] || usage; role=$1 ;;
        --offline) source=${2:?--offline needs the bundle}; shift ;;
        --base) base_address=${2:?--base needs an address}; shift ;;
        --time) time_source=${2:?--time needs pps, ntp or none}; shift ;;
        --no-start) start=no ;;
        --purge) purge=yes ;;
        *) usage ;;
    esac
    shift
done
[ -n "$role" ] || usage
case ${time_source:=none} in pps|ntp|none) ;; *) usage ;; esac
case $base_address in *[!0-9A-Za-z.:-]*) fail "$base_address is no address" "give the base's IP address or name" 2 ;; esac
[ "$(id -u)" = 0 ] || fail "not root" "run it with sudo"
case $role in edge) service=edge-node ;; base) service=base-station ;; router) service=skyfix-router ;; *) service='' ;; esac

# Steps

find_python() {
    for candidate in python3.11 python3.12 python3.13 python3.14 python3; do
        if command -v "$candidate" >/dev/null &&
           "$candidate" -c 'import sys, venv; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            command -v "$candidate"
            return
        fi
    done
    fail "no Python 3.11 or later" "apt install python3"
}

unpack() {    # the bundle's or source tree's folder, in $tree
    if [ -z "$source" ]; then
        tree=$(cd "$(dirname "$0")/.." && pwd)
    elif [ -d "$source" ]; then
        tree=$(cd "$source" && pwd)
    else
        [ -r "$source" ] || fail "$source cannot be read" "give the path of skyfix-<version>-bundle.tar"
        scratch=$(mktemp -d)
        trap 'rm -rf "$scratch"' EXIT
        tar -xf "$source" -C "$scratch"
        tree=$(echo "$scratch"/*/)
        tree=${tree%/}
    fi
    if [ -n "$source" ]; then
        (cd "$tree" && sha256sum --check --quiet --strict SHA256SUMS) ||
            fail "the bundle is damaged" "copy it again; its files do not have the checksums in SHA256SUMS"
    fi
}

read_version() {
    if [ -n "$source" ]; then
        local wheel
        wheel=$(basename "$tree"/wheels/skyfix-*.whl)
        version=${wheel#skyfix-}
        version=${version%%-*}
    else
        version=$(sed -n 's/^__version__ = "\(.*\)"/\1/p' "$tree/edge/__init__.py")
    fi
    [ -n "$version" ] || fail "no version found in $tree" "use the bundle or a complete source tree"
}

make_user() {
    install -d "$PREFIX" "$CONFIG"
    if ! getent passwd skyfix >/dev/null; then
        useradd --system --user-group --home-dir "$STATE" --no-create-home --shell /usr/sbin/nologin skyfix
    fi
    for group in video dialout; do
        if getent group "$group" >/dev/null; then usermod --append --groups "$group" skyfix; fi
    done
    install -d -m 0750 -o skyfix -g skyfix "$STATE"
    install -d -m 0750 -o root -g skyfix "$CONFIG" "$CONFIG/certs"
}

lay_programs() {    # /opt/skyfix/$version, whole or not at all
    local place="$PREFIX/$version" roles=$role extras='' python each
    # One machine may be base and box: what was laid for one of them stays when the other comes.
    for each in edge base router; do
        if [ "$each" != "$role" ] && [ -e "$place/.complete-$each" ]; then roles+=" $each"; fi
    done
    for each in $roles; do
        case $each in edge) extras+=,box ;; base) extras+=,base,page,certs ;; esac
    done
    if [ -n "$extras" ]; then extras="[${extras#,}]"; fi
    if [ -e "$place/.complete-$role" ] && [ -n "$source" ] && cmp -s "$tree/SHA256SUMS" "$place/SHA256SUMS"; then
        say "$version is laid already"
        return
    fi
    python=$(find_python)
    say "laying $version with $("$python" --version)"
    rm -f "$place"/.complete*
    "$python" -m venv --without-pip --clear "$place"
    if [ -n "$source" ]; then
        local pip
        pip=$(echo "$tree"/wheels/pip-*.whl)
        "$place/bin/python" "$pip/pip" --isolated --quiet --disable-pip-version-check install --no-index \
            --find-links "$tree/wheels" "skyfix$extras==$version" ||
            fail "the bundle has no wheels for $("$python" --version) on $(uname -m)" \
                 "build it with: python -m tools.bundle --python $("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')"
        cp "$tree/SHA256SUMS" "$place/"
    else
        "$python" -m ensurepip --version >/dev/null 2>&1 || fail "no pip for $python" "apt install python3-venv"
        "$python" -m venv --upgrade "$place"
        "$place/bin/python" -m ensurepip --default-pip >/dev/null
        "$place/bin/python" -m pip --quiet --disable-pip-version-check install \
            --constraint <(grep -oE '^[A-Za-z0-9._-]+==[^ ]+' "$tree/requirements.lock") "$tree$extras"
    fi
    rm -rf "$place/deploy" "$place/systemd"
    cp -r "$tree/deploy" "$tree/systemd" "$tree/README.md" "$place/"
    "$place/bin/python" -m compileall -q "$place/lib" >/dev/null || true
    for each in $roles; do touch "$place/.complete-$each"; done
    sync -f "$place"
}

switch_to() {    # the version of $1 is the current one, in one step
    if [ "$(readlink "$PREFIX/current" || true)" != "$1" ]; then
        [ -L "$PREFIX/current" ] && ln -sfn "$(readlink "$PREFIX/current")" "$PREFIX/previous"
        ln -sfn "$1" "$PREFIX/.next"
        mv -T "$PREFIX/.next" "$PREFIX/current"
    fi
}

lay_units() {
    install -m 0644 "$PREFIX"/current/systemd/* "$UNITS/"
    install -D -m 0644 "$PREFIX/current/deploy/udev/70-skyfix.rules" /etc/udev/rules.d/70-skyfix.rules
    install -D -m 0644 "$PREFIX/current/deploy/sysctl/60-skyfix.conf" /etc/sysctl.d/60-skyfix.conf
    # systemd 254 and later can wait longer from time to time; older ones know the words not.
    if has_systemd && [ "$(systemctl --version | sed -n '1s/systemd \([0-9]*\).*/\1/p')" -ge 254 ]; then
        for unit in edge-node base-station skyfix-router; do
            install -d "$UNITS/$unit.service.d"
            printf '[Service]\nRestartSteps=6\nRestartMaxDelaySec=60\n' >"$UNITS/$unit.service.d/back-off.conf"
        done
    fi
    if has_systemd; then
        systemctl daemon-reload
        /usr/lib/systemd/systemd-sysctl /etc/sysctl.d/60-skyfix.conf || true
        if [ -S /run/udev/control ]; then udevadm control --reload && udevadm trigger || true; fi
    fi
}

lay_configuration() {    # templates where there is nothing yet
    local name=$role
    if [ ! -e "$CONFIG/$name.toml" ]; then
        local template="$PREFIX/current/deploy/$name.example.toml"
        [ "$role" = router ] && template="$PREFIX/current/deploy/router/router.example.toml"
        install -m 0640 -o root -g skyfix "$template" "$CONFIG/$name.toml"
        sed -i "1s|^#:schema .*schema/|#:schema $PREFIX/current/deploy/schema/|" "$CONFIG/$name.toml"
        say "wrote $CONFIG/$name.toml: edit it"
    fi
    if [ "$role" = base ] && [ ! -e "$CONFIG/mavlink.key" ]; then
        (umask 077 && od -An -N32 -tx1 /dev/urandom | tr -d ' \n' >"$CONFIG/mavlink.key")
        chown skyfix:skyfix "$CONFIG/mavlink.key"
    fi
}

lay_time() {
    local file=/etc/chrony/conf.d/skyfix.conf template=''
    case $role-$time_source-${base_address:+given} in
        edge-*-given) template=box.conf ;;
        base-pps-*) template=base-pps.conf ;;
        base-ntp-*) template=base-ntp.conf ;;
        *) return 0 ;;
    esac
    if ! command -v chronyd >/dev/null; then
        say "WARN chrony is not installed: apt install chrony, then run this again; without it times are not comparable"
        return 0
    fi
    install -d "$(dirname "$file")"
    sed "/^server/s/192\.0\.2\.1/${base_address:-192.0.2.1}/" "$PREFIX/current/deploy/chrony/$template" >"$file.new"
    chronyd -p -f "$file.new" >/dev/null || fail "chronyd does not understand $file.new" "look at it; nothing was changed"
    mv "$file.new" "$file"
    if has_systemd; then systemctl try-restart chrony.service; fi
}

comes_up() {
    local waited=0
    while [ "$waited" -lt "$COMES_UP_S" ]; do
        if systemctl --quiet is-active "$service"; then
            sleep 3 && systemctl --quiet is-active "$service" && return 0
        fi
        sleep 1
        waited=$((waited + 1))
    done
    return 1
}

start_service() {
    if ! has_systemd || [ "$start" = no ]; then
        say "not started; start it with: systemctl enable --now $service"
        return
    fi
    local fresh=no
    [ -e "$PREFIX/previous" ] || fresh=yes
    systemctl --quiet enable "$service" skyfix-access.path
    systemctl --quiet restart skyfix-access.path
    systemctl restart "$service" || true
    comes_up && { say "$service runs"; return; }
    if [ "$fresh" = no ] && [ "$(readlink "$PREFIX/previous")" != "$version" ]; then
        say "$service $version does not come up; going back to $(readlink "$PREFIX/previous")"
        systemctl --no-pager --lines=10 status "$service" >&2 || true
        roll_back
        exit 1
    fi
    say "WARN $service does not run yet: correct $CONFIG/$role.toml, then: systemctl restart $service"
}

roll_back() {
    local last
    last=$(readlink "$PREFIX/previous") || fail "there is no version before" "nothing was changed"
    [ -x "$PREFIX/$last/bin/python" ] || fail "$PREFIX/$last is gone" "install that version again"
    switch_to "$last"
    lay_units
    if has_systemd; then
        for unit in edge-node base-station skyfix-router; do systemctl try-restart "$unit.service" || true; done
    fi
    say "the current version is $last"
}

uninstall() {
    if has_systemd; then
        systemctl --quiet disable --now edge-node base-station skyfix-router skyfix-ntrip skyfix-access.path 2>/dev/null || true
    fi
    rm -f "$UNITS"/{edge-node,base-station,skyfix-router,skyfix-ntrip,skyfix-access}.service "$UNITS/skyfix-access.path"
    rm -rf "$UNITS"/{edge-node,base-station,skyfix-router}.service.d
    rm -f /etc/udev/rules.d/70-skyfix.rules /etc/sysctl.d/60-skyfix.conf /etc/chrony/conf.d/skyfix.conf
    rm -rf "$PREFIX"
    if has_systemd; then systemctl daemon-reload; fi
    if [ "$purge" = yes ]; then
        rm -rf "$CONFIG" "$STATE"
        if getent passwd skyfix >/dev/null; then userdel skyfix; fi
        say "removed, with configuration and recordings"
    else
        say "removed; $CONFIG and $STATE are kept (--purge removes them)"
    fi
}

check_hardware() {
    local command
    case $role in
        edge) command=edge-node ;;
        base) command=base-station ;;
        *) return 0 ;;
    esac
    say "what is missing on this machine:"
    "$PREFIX/current/bin/$command" check --config "$CONFIG/$role.toml" 2>&1 | grep -E '^(PASS|WARN|FAIL)|'"$command"':' || true
}

case $role in
    rollback) roll_back; exit 0 ;;
    uninstall) uninstall; exit 0 ;;
esac
unpack
read_version
make_user
lay_programs
switch_to "$version"
lay_units
lay_configuration
lay_time
start_service
check_hardware
say "$version is installed as $role"
