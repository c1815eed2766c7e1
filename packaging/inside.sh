#!/bin/bash
# In the container of packaging/try: what a person does with the packages, and whether it came true.
set -euo pipefail
cd /try
export DEBIAN_FRONTEND=noninteractive LC_ALL=C.UTF-8
control=
trap '[ -z "$control" ] || kill "$control" 2>/dev/null || true' EXIT

fail() { echo "inside.sh: $*"; systemctl status --no-pager --full --lines=20 volcompd.service || true; exit 1; }
is() { # is WHAT WANTED FOUND
  [ "$2" = "$3" ] || fail "$1: wanted '$2', found '$3'"
}
# exit codes up to 4 tell the health of a daemon that answers
status() { volcomp status --json || [ $? -le 4 ]; }
# until PATTERN...: a status that has all of them
until_status() {
  local now=''
  for _ in $(seq 300); do
    now=$(status 2>/dev/null || true)
    for pattern in "$@"; do [[ "$now" == *"$pattern"* ]] || { sleep 0.1; continue 2; }; done
    return 0
  done
  fail "no status with $* but $now"
}
http() { # http PATH
  exec 3<>/dev/tcp/127.0.0.1/7870
  printf 'GET %s HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n' "$1" >&3
  cat <&3
  exec 3>&-
}
property() { systemctl show --property="$1" --value "$2"; }

echo "== installed"
dpkg -i volcomp_*.deb
id volcomp >/dev/null || fail "no user volcomp"
is "the daemon" active "$(systemctl is-active volcompd)"
is "at the next start" enabled "$(systemctl is-enabled volcompd)"
is "the gateway at the next start" disabled "$(systemctl is-enabled volcomp-gateway || true)"
until_status '"state":"disconnected"'
for file in /usr/share/man/man1/volcomp.1.gz /usr/share/man/man8/volcompd.8.gz /usr/share/man/man1/volcomp-fit.1.gz \
  /usr/share/bash-completion/completions/volcomp /usr/share/doc/volcomp/how-to/operating.md /usr/share/doc/volcomp/copyright; do
  [ -e "$file" ] || fail "no $file"
done
(source /usr/share/bash-completion/completions/volcomp && complete -p volcomp >/dev/null) || fail "no completion"

echo "== used as docs/how-to/installing.md has it"
cncsim path circle >/try/part.nc
cncsim serve --program /try/part.nc --loop >/try/control.log 2>&1 &
control=$!
volcomp enable --reason 'first trial'
until_status '"state":"active"'
sed -i 's|^# listen = "127.0.0.1:7870"|listen = "127.0.0.1:7870"  |' /etc/volcomp/machine.toml
volcomp check /etc/volcomp/machine.toml >/dev/null
systemctl restart volcompd
until_status '"up":true'
volcomp enable
until_status '"state":"active"'
http / | grep -qF '<title' || fail "no page"
http /metrics | grep -q '^volcomp_cycles_total ' || fail "no metrics"
http /api/v1/status | grep -qF '"machine":"vmc-850"' || fail "no status over HTTP"

# systemd gives its units no more than it may give itself
if prlimit --memlock=1073741824 --rtprio=60 true 2>/dev/null; then
  echo "== real time and confinement of the unit, by systemd/exercise.sh"
  until_status '"fifo":"yes' '"memory_lock":"yes'
  VOLCOMP_PROGRAMS=/usr/bin repo/systemd/exercise.sh || fail "exercise.sh ended with $?"
else
  echo "== NOT tried: real time and confinement of the unit; this computer cannot raise limits (CAP_SYS_RESOURCE)"
fi

echo "== upgraded"
pid=$(property MainPID volcompd)
sum=$(md5sum </etc/volcomp/machine.toml)
dpkg --force-confdef --force-confold -i later.deb
is "configuration" "$sum" "$(md5sum </etc/volcomp/machine.toml)"
is "the process that compensates" "$pid" "$(property MainPID volcompd)"
until_status '"state":"active"'
dpkg-query -W -f '${Version}' volcomp | grep -qF later || fail "not upgraded"
[ -e /etc/volcomp/machine.toml.dpkg-dist ] || fail "the new default configuration is not laid beside"
rm /etc/volcomp/machine.toml.dpkg-dist

echo "== OPC UA"
dpkg -i volcomp-opcua_*.deb
is "OPC UA" inactive "$(systemctl is-active volcomp-opcua || true)"
systemctl start volcomp-opcua
for _ in $(seq 100); do (exec 3<>/dev/tcp/127.0.0.1/4840) 2>/dev/null && break; sleep 0.1; done
(exec 3<>/dev/tcp/127.0.0.1/4840) || fail "OPC UA does not listen"
sleep 3
is "OPC UA" active "$(systemctl is-active volcomp-opcua)"
journalctl -u volcomp-opcua --no-pager | grep -qF 'volcompd of vmc-850 answers' || fail "OPC UA has no status: $(journalctl -u volcomp-opcua --no-pager)"
dpkg --purge volcomp-opcua
is "OPC UA" inactive "$(systemctl is-active volcomp-opcua || true)"

echo "== LinuxCNC"
dpkg -i volcomp-linuxcnc_*.deb
ldd /usr/bin/volcomp_bridge | grep -qF 'not found' && fail "the bridge lacks a library"
said=$(volcomp_bridge 2>&1 || true)
[[ "$said" == *'usage: volcomp_bridge'* ]] || fail "the bridge says '$said'"
for line in $(sed -n 's|^HALFILE = LIB:||p' /usr/share/doc/volcomp-linuxcnc/examples/*.ini); do
  [ -e "/usr/share/linuxcnc/hallib/$line" ] || fail "no HAL file $line"
done
dpkg --purge volcomp-linuxcnc

echo "== removed, installed again, purged"
dpkg --remove volcomp
is "the daemon" inactive "$(systemctl is-active volcompd || true)"
[ ! -e /usr/bin/volcompd ] || fail "the program is still there"
is "configuration" "$sum" "$(md5sum </etc/volcomp/machine.toml)"
[ -d /var/lib/volcomp ] || fail "counters and audit log are gone"
dpkg --force-confdef --force-confold -i later.deb
is "the daemon" active "$(systemctl is-active volcompd)"
is "configuration" "$sum" "$(md5sum </etc/volcomp/machine.toml)"
until_status '"state":"'
dpkg --purge volcomp
for place in /etc/volcomp /var/lib/volcomp /run/volcomp /usr/share/doc/volcomp /usr/lib/systemd/system/volcompd.service \
  /etc/systemd/system/multi-user.target.wants/volcompd.service; do
  [ ! -e "$place" ] || fail "$place is left"
done
echo "packages: installed, started, used, upgraded with configuration and process kept, removed, purged"
