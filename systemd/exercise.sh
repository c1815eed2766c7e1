#!/bin/sh
# Runs the daemon under the hardened unit and looks whether it works there: ready, linked to a simulated control on
# loopback, compensating, with real-time scheduling and locked memory, without privileges, still alive after a period
# of its watchdog, and ended in order. Needs systemd as process 1, root, and the programs (target/release, or where
# VOLCOMP_PROGRAMS says). Leaves nothing behind.
# Exit codes: 0 it works; 1 it does not; 77 it cannot be tried here (the reason is on stdout).
set -eu
cd "$(dirname "$0")"

programs=${VOLCOMP_PROGRAMS:-../target/release}
name=volcompd-check
place=/usr/local/lib/$name          # not in /run or /var, which may be mounted without permission to execute
unit=/run/systemd/system/$name.service
socket=/run/$name/volcompd.sock
control=

cannot() { echo "$*"; exit 77; }
fail() {
    echo "systemd/exercise.sh: $*" >&2
    systemctl status --no-pager --full --lines=30 "$name.service" >&2 || true
    exit 1
}

[ "$(cat /proc/1/comm)" = systemd ] && [ -d /run/systemd/system ] || cannot "systemd is not process 1 here"
[ "$(id -u)" = 0 ] || cannot "only root can start units"
for program in volcompd volcomp cncsim; do
    [ -x "$programs/$program" ] || cannot "no program $programs/$program"
done
[ ! -e "$place" ] && [ ! -e "$unit" ] || cannot "$place or $unit exists: another check, or what is left of one"

tidy() {
    systemctl stop "$name.service" >/dev/null 2>&1 || true
    systemctl reset-failed "$name.service" >/dev/null 2>&1 || true
    [ -z "$control" ] || kill "$control" 2>/dev/null || true
    rm -rf "$place" "$unit"
    systemctl daemon-reload
}
trap tidy EXIT
trap 'exit 1' INT TERM

# the program, a machine file, and a control to talk to
mkdir -p "$place/etc"
install -m 755 "$programs/volcompd" "$place/volcompd"
"$programs/cncsim" serve --listen 127.0.0.1:0 >"$place/control.log" 2>&1 &
control=$!
for _ in $(seq 50); do
    address=$(sed -n 's/^listening on //p' "$place/control.log")
    [ -z "$address" ] || break
    sleep 0.1
done
[ -n "$address" ] || fail "the simulated control does not listen: $(cat "$place/control.log")"
sed -e "s|^address = .*|address = \"$address\"|" -e 's|^\[engine\]|[engine]\nstart = "on-connect"|' \
    ../config/examples/vmc-850/machine.toml >"$place/etc/machine.toml"
printf '\n[status]\nsocket = "%s"\n' "$socket" >>"$place/etc/machine.toml"
cp ../config/examples/vmc-850/model.toml "$place/etc/"
"$programs/volcomp" check "$place/etc/machine.toml" >/dev/null || fail "the machine file of the check is wrong"

# the unit as it is shipped, but for its paths; a user of its own that exists only as long as it runs
sed -e "s|/usr/bin/volcompd|$place/volcompd|" -e "s|/etc/volcomp/|$place/etc/|" \
    -e "s|^\(Runtime\|State\)Directory=volcomp$|\1Directory=$name|" \
    -e "s|^\(User\|Group\)=volcomp$|\1=$name|" -e 's|^\[Service\]$|[Service]\nDynamicUser=yes|' \
    volcompd.service >"$unit"
grep -q "^ExecStart=$place/volcompd --config $place/etc/machine.toml$" "$unit" || fail "the unit's ExecStart has changed"
systemctl daemon-reload
# Type=notify: this returns when the daemon has said READY=1
systemctl start "$name.service" || fail "it does not start"

# exit codes up to 4 tell the health of a daemon that answers
status() { "$programs/volcomp" status --json --socket "$socket" || [ $? -le 4 ]; }
for _ in $(seq 150); do
    case $(status 2>/dev/null) in *'"state":"active"'*) break ;; esac
    sleep 0.1
done
now=$(status) || fail "no answer on $socket"
case $now in *'"state":"active"'*) ;; *) fail "it does not compensate: $now" ;; esac
case $now in *'"fifo":"yes'*) ;; *) fail "SCHED_FIFO refused in the sandbox: $now" ;; esac
case $now in *'"memory_lock":"yes'*) ;; *) fail "memory lock refused in the sandbox: $now" ;; esac

# what the sandbox takes away
pid=$(systemctl show --property=MainPID --value "$name.service")
for line in 'CapEff:	0000000000000000' 'CapBnd:	0000000000000000' 'NoNewPrivs:	1' 'Seccomp:	2'; do
    grep -q "^$line$" "/proc/$pid/status" || fail "not in /proc/$pid/status: $line"
done
grep -q '^Uid:	0	' "/proc/$pid/status" && fail "it runs as root"
# even root cannot write where it lives
for path in /etc /usr /var /root /home; do
    if nsenter --target "$pid" --mount touch "$path/$name" 2>/dev/null; then
        rm -f "$path/$name"
        fail "$path can be written from inside"
    fi
done

# longer than WatchdogSec=: the watchdog is fed
sleep 11
[ "$(systemctl show --property=ActiveState --value "$name.service")" = active ] || fail "it did not stay active"
[ "$(systemctl show --property=NRestarts --value "$name.service")" = 0 ] || fail "it was restarted"
systemctl stop "$name.service"
for pair in Result=success ExecMainStatus=0 ExecMainCode=1; do
    [ "$(systemctl show --property="${pair%=*}" "$name.service")" = "$pair" ] || fail "it did not end in order: no $pair"
done
