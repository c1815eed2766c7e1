#!/bin/sh
# Checks the units: they parse, they name nothing that systemd does not know, they stay hardened, and the instance
# unit does not drift from the plain one. Needs systemd-analyze; says so and passes where there is none. Where systemd
# runs as process 1 the sandboxed service is exercised too (exercise.sh); the last line says which of both was done.
set -eu
cd "$(dirname "$0")"

# Exposure allowed, in tenths: 2.0.
threshold=20

if ! command -v systemd-analyze >/dev/null 2>&1; then
    echo "systemd/check.sh: systemd-analyze is not installed; units not checked" >&2
    exit 0
fi

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# verify wants the program to exist: a stub stands in for it where it is not installed
printf '#!/bin/sh\nexit 0\n' >"$work/volcompd"
cp "$work/volcompd" "$work/volcomp"
chmod 755 "$work/volcompd" "$work/volcomp"
cp "$work/volcompd" "$work/volcomp-opcua"
sed "s|^ExecStart=/usr/bin/volcomp |ExecStart=$work/volcomp |" volcomp-gateway.service >"$work/volcomp-gateway.service"
sed "s|^ExecStart=/usr/bin/volcomp-opcua |ExecStart=$work/volcomp-opcua |" volcomp-opcua.service >"$work/volcomp-opcua.service"
for unit in volcompd.service volcompd@.service; do
    sed "s|^ExecStart=/usr/bin/volcompd|ExecStart=$work/volcompd|" "$unit" >"$work/$unit"
    grep -q "^ExecStart=$work/volcompd --config " "$work/$unit" || {
        echo "systemd/check.sh: $unit: ExecStart is not /usr/bin/volcompd --config" >&2
        exit 1
    }
done
for unit in volcompd.service volcompd@demo.service volcomp-gateway.service volcomp-opcua.service; do
    file=$work/$unit
    [ -e "$file" ] || cp "$work/volcompd@.service" "$file"
    # verify reports unknown keys on stderr without failing: any word of it is an error here
    said=$(systemd-analyze verify --man=no "$file" 2>&1) || {
        echo "systemd/check.sh: $unit: $said" >&2
        exit 1
    }
    if printf '%s\n' "$said" | grep -F "$work" >&2; then
        echo "systemd/check.sh: $unit: systemd-analyze verify complains (above)" >&2
        exit 1
    fi
done

for unit in volcompd.service volcompd@.service volcomp-gateway.service volcomp-opcua.service; do
    systemd-analyze security --offline=true --no-pager --threshold="$threshold" "$unit" >"$work/report" || {
        cat "$work/report" >&2
        echo "systemd/check.sh: $unit: exposure above $threshold tenths" >&2
        exit 1
    }
    echo "$unit: $(tail -n 1 "$work/report")"
done

# help is ours, where the package puts it
for unit in volcompd.service volcompd@.service volcomp-gateway.service volcomp-opcua.service; do
    page=$(sed -n 's|^Documentation=file:/usr/share/doc/volcomp/||p' "$unit")
    [ -n "$page" ] && [ -e "../docs/$page" ] || {
        echo "systemd/check.sh: $unit: Documentation= names no page of docs/" >&2
        exit 1
    }
done

# what real time needs must not be hardened away
for unit in volcompd.service volcompd@.service; do
    for line in 'RestrictRealtime=no' 'LimitRTPRIO=[1-9]' 'LimitMEMLOCK=' 'SystemCallFilter=@system-service @memlock'; do
        grep -q "^$line" "$unit" || {
            echo "systemd/check.sh: $unit: no line $line: SCHED_FIFO or the memory lock would fail" >&2
            exit 1
        }
    done
    if grep -Eq '^SystemCallFilter=~.*@(resources|memlock)' "$unit"; then
        echo "systemd/check.sh: $unit: @resources and @memlock must stay allowed" >&2
        exit 1
    fi
done

plain() { grep -v '^#' "$1" | grep -v '^$'; }
plain volcompd.service | sed -e 's|/etc/volcomp/|/etc/volcomp/%i/|' -e 's|of a machine tool|of machine tool %i|' \
    -e 's|^RuntimeDirectory=volcomp$|RuntimeDirectory=volcomp-%i|' \
    -e 's|^StateDirectory=volcomp$|StateDirectory=volcomp-%i|' >"$work/expected"
plain 'volcompd@.service' >"$work/found"
diff -u "$work/expected" "$work/found" >&2 || {
    echo "systemd/check.sh: volcompd@.service differs from volcompd.service in more than its paths" >&2
    exit 1
}

code=0
reason=$(./exercise.sh) || code=$?
case $code in
0) echo "units: ok; score checked and the sandboxed service exercised under $(systemd-analyze --version | head -n 1)" ;;
77) echo "units: ok by their score alone; the sandboxed service was not exercised: $reason" ;;
*) exit 1 ;;
esac
