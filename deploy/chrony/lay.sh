#!/bin/bash
# Give this machine its time: a configuration for chronyd, tried before it stays. Run as root; install.sh runs it too.
#
#   lay.sh box ADDRESS     follow the base at this address
#   lay.sh base-pps        serve a site from a GNSS receiver's pulse, /dev/pps0
#   lay.sh base-ntp        serve a site from the internet
#   lay.sh none            back to what Debian laid
#
# chronyd reads /etc/chrony/skyfix.conf instead of chrony.conf, by one drop-in of its service: nothing of Debian's is
# changed, and nothing of Debian's is read after it. If chronyd does not come up with it, what was there before is put back.
# With certificates in /etc/skyfix/certs the base proves that it is the base (NTS), and boxes ask it to.
set -euo pipefail

readonly ETC=${SKYFIX_ETC:-/etc} PPS=${SKYFIX_PPS:-/dev/pps0} NTS_PORT=4460
readonly CHRONY=$ETC/chrony CERTS=$ETC/skyfix/certs
readonly CONF=$CHRONY/skyfix.conf DROP_IN=$ETC/systemd/system/chrony.service.d/skyfix.conf
readonly UP_S=10    # chronyd is up or has failed within a second; a Raspberry Pi that starts has much else to do

here=$(cd "$(dirname "$0")" && pwd)
say() { echo "skyfix: $*"; }
usage() { sed -n '2,7s/^# \{0,1\}//p' "$0" >&2; exit 2; }
has_systemd() { [ -d /run/systemd/system ]; }

kind=${1:-} address=${2:-}
case $kind in
    box) [ -n "$address" ] || usage ;;
    base-pps|base-ntp|none) ;;
    *) usage ;;
esac
case $address in *[!0-9A-Za-z.:-]*) say "$address is no address; give the base's IP address or name" >&2; exit 2 ;; esac

restart() {    # 0: chronyd runs, or is not wanted here; 1: it has failed
    has_systemd || return 0
    systemctl daemon-reload
    systemctl --quiet is-enabled chrony.service 2>/dev/null || return 0
    systemctl reset-failed chrony.service 2>/dev/null || true
    systemctl restart chrony.service || return 1
    # Its own conditions may keep it from starting, as in a container.
    [ "$(systemctl show --property=ConditionResult --value chrony.service)" != no ] || return 0
    local waited=0
    while [ "$waited" -lt "$UP_S" ]; do
        systemctl --quiet is-failed chrony.service && return 1
        if systemctl --quiet is-active chrony.service; then
            sleep 1
            systemctl --quiet is-active chrony.service && return 0
        fi
        sleep 1
        waited=$((waited + 1))
    done
    return 0    # neither up nor failed: it is said by whoever looks
}

take_back() {
    rm -f "$DROP_IN" "$CONF" "$CHRONY/skyfix.env" "$CHRONY/conf.d/skyfix.conf" "$CHRONY"/skyfix-*.pem
    rmdir "$(dirname "$DROP_IN")" 2>/dev/null || true
}

give_to_chrony() {    # $1 as $2, which chronyd's user and nobody else reads
    install -m 0640 "$1" "$2.new"
    if getent group _chrony >/dev/null; then chgrp _chrony "$2.new"; fi
    mv "$2.new" "$2"
}

speaks_nts() { timeout 3 bash -c "exec 3<>'/dev/tcp/$address/$NTS_PORT'" 2>/dev/null; }

authentication() {    # the lines that prove who the base is, where there are certificates
    case $kind in
        box)
            [ -r "$CERTS/authority.pem" ] || return 0
            if ! speaks_nts; then
                say "WARN the base does not prove its time (NTS, port $NTS_PORT): lay its certificates, run this there, then here" >&2
                return 0
            fi
            give_to_chrony "$CERTS/authority.pem" "$CHRONY/skyfix-authority.pem"
            printf 'ntstrustedcerts %s\nnosystemcert\n' "$CHRONY/skyfix-authority.pem"
            # A box without a battery begins in a year in which no certificate is good yet.
            echo 'nocerttimecheck 3' ;;
        base-*)
            if ! [ -r "$CERTS/key.pem" ] || ! [ -r "$CERTS/certificate.pem" ]; then return 0; fi
            give_to_chrony "$CERTS/key.pem" "$CHRONY/skyfix-key.pem"
            give_to_chrony "$CERTS/certificate.pem" "$CHRONY/skyfix-certificate.pem"
            printf 'ntsserverkey %s\nntsservercert %s\n' "$CHRONY/skyfix-key.pem" "$CHRONY/skyfix-certificate.pem" ;;
    esac
}

if [ "$kind" = none ]; then
    # Where nothing was laid, chronyd is somebody else's.
    if ! [ -e "$DROP_IN" ] && ! [ -e "$CONF" ]; then exit 0; fi
    take_back
    restart || say "WARN chronyd does not run: systemctl status chrony"
    exit 0
fi
if ! command -v chronyd >/dev/null; then
    say "WARN chrony is not installed: apt install chrony, then run this again; without it times are not comparable"
    exit 0
fi
if [ "$kind" = base-pps ] && ! [ -c "$PPS" ]; then
    say "WARN there is no $PPS: time was left as it was; deploy/chrony/PPS.md says how to get it, then run this again"
    exit 0
fi

install -d "$CHRONY"
proof=$(authentication)
sed "s/192\.0\.2\.1/${address:-192.0.2.1}/" "$here/$kind.conf" >"$CONF.new"
case $proof in *ntstrustedcerts*) sed -i '/^server /s/$/ nts/' "$CONF.new" ;; esac
if [ -n "$proof" ]; then echo "$proof" >>"$CONF.new"; fi
if ! told=$(chronyd -p -f "$CONF.new" 2>&1); then
    say "chronyd does not understand $CONF.new: ${told##*$'\n'}; nothing was changed" >&2
    exit 1
fi
before=''
if [ -e "$CONF" ]; then before=$CONF.before; cp -p "$CONF" "$before"; fi
mv "$CONF.new" "$CONF"
rm -f "$CHRONY/conf.d/skyfix.conf"    # of earlier versions: Debian's own came after it and won
install -d "$(dirname "$DROP_IN")"
printf '[Service]\nEnvironmentFile=%s\n' "$CHRONY/skyfix.env" >"$DROP_IN"
echo "DAEMON_OPTS=\"-F 1 -f /etc/chrony/skyfix.conf\"" >"$CHRONY/skyfix.env"
if ! restart; then
    say "WARN chronyd does not run with $CONF; what was there before is put back" >&2
    if has_systemd; then journalctl --unit chrony --lines 5 --no-pager --output cat >&2 || true; fi
    if [ -n "$before" ]; then mv "$before" "$CONF"; else take_back; fi
    restart || say "WARN chronyd does not run: systemctl status chrony" >&2
    exit 0
fi
rm -f "$CONF.before"
say "time: $kind${address:+ of $address}, $([ -n "$proof" ] && echo authenticated || echo not authenticated); chronyc -n sources shows whom it follows"
