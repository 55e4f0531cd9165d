#!/bin/bash
# What somebody does who gets a package of Isocortex: installs it, starts it, sees a picture, upgrades it over itself and removes it.
#
#   dist-walk.sh archive|wheel|deb|image FILE OUT
#
# dist-test.sh calls it where the package is to be installed, without a network: in an empty folder, in a fresh environment of Python, as
# root of a Debian that has just been booted, or with Docker. The pictures and what was printed go to the folder OUT.
set -euo pipefail
readonly kind=$1 file=$2 out=$3
export DEBIAN_FRONTEND=noninteractive
begun=$(date +%s%N)
mkdir -p "$out"

step() { printf '%s %6.1f s  %s\n' "$kind" "$((($(date +%s%N) - begun) / 100000000))e-1" "$*"; }
fail() {
  step "FAILED: $*"
  exit 1
}
readonly server=http://127.0.0.1:8640
authorization=()
ask() { curl -sSf "${authorization[@]}" "$@"; }
picture() { ask -o "$out/$3.png" "$1/v1/cases/$2/render?depth_mm=12&view=left" && step "picture: $3"; }

# Uploads a head to the server, waits until it is ready, and sets `id`.
upload() {
  id=$(ask -F "volume=@$1" $server/v1/cases | grep -o '[0-9a-f]\{32\}' | head -n 1)
  ask -N --max-time 600 "$server/v1/cases/$id/events" | grep -q '"state":"ready"' || fail "the case is not ready"
}

# The demo of a program, until its picture is there; then it is stopped as by Ctrl-C.
demo() {
  local program=$1 name=$2 said=$out/$2.txt page address
  : >"$said"
  "$program" demo --data "$PWD/data" --listen 127.0.0.1:0 >>"$said" 2>&1 &
  until page=$(grep -oE 'http://[^ ]+' "$said"); do
    kill -0 $! 2>/dev/null || fail "the demo ended: $(cat "$said")"
    sleep 0.1
  done
  step "the demo printed $page"
  address=${page%%/#*} page=${page##*/#}
  picture "$address" "${page%%&*}" "$name"
  kill -INT $!
  wait $! || fail "the demo ended with $?"
}

# The blocks of docs/install.md that are marked for this test, as root would type them.
documented() {
  sed -n "/<!-- dist-test: $1 -->/,/^\`\`\`\$/p" "$out/install.md" | sed '1,2d;$d' >"$out/$1.sh"
  [ -s "$out/$1.sh" ] || fail "docs/install.md has no block \`$1\`"
  bash -euxo pipefail "$out/$1.sh" >"$out/$1.txt" 2>&1 || fail "$1: $(tail -n 5 "$out/$1.txt")"
  step "as documented: $1"
}

answers() {
  curl -sSf --retry 50 --retry-connrefused --retry-delay 1 -o /dev/null $server/healthz 2>/dev/null || fail "no answer: $(log 2>&1 | tail -n 5)"
}
log() {
  case $kind in
    image) docker logs isocortex-walk ;;
    *) journalctl -u isocortex --no-pager ;;
  esac
}

case $kind in
  archive)
    tar -xzf "$file"
    program=$PWD/$(basename "$file" .tar.gz)/bin/isocortex
    "$program" && "$program" --version && "$program" doctor
    demo "$program" first
    tar -xzf "$file"
    demo "$program" upgraded
    rm -r "$(basename "$file" .tar.gz)"
    ;;
  wheel)
    "${PYTHON:-python3}" -m venv environment
    # What the wheel needs lies there, for lack of a network.
    install=(environment/bin/pip install --quiet --no-index --find-links "$WHEELS" --disable-pip-version-check)
    "${install[@]}" "$file"
    step "installed by $(environment/bin/python --version)"
    demo environment/bin/isocortex first
    environment/bin/python - "$out/python.png" <<'E1'
import sys
from pathlib import Path

import isocortex as iso

case = iso.open(Path(sys.prefix, "share/isocortex/ch2.nii.gz"))
Path(sys.argv[1]).write_bytes(case.png(12.0, view="left"))
E1
    step "picture: python"
    "${install[@]}" --force-reinstall "$file"
    demo environment/bin/isocortex upgraded
    environment/bin/pip uninstall --quiet --yes isocortex
    [ -z "$(find environment -name '*isocortex*' -print -quit)" ] || fail "files are left"
    ;;
  deb)
    cd "$(dirname "$file")"
    apt-get install -y --no-install-recommends "$file" >"$out/install.txt" 2>&1 || fail "$(tail -n 5 "$out/install.txt")"
    step "installed"
    answers
    [ "$(ps -o user= -p "$(systemctl show -p MainPID --value isocortex)")" = isocortex ] || fail "it runs as another user"
    step "the service listens"
    upload /usr/share/isocortex/ch2.nii.gz
    picture $server "$id" first
    runuser -u isocortex -- isocortex doctor --config /etc/isocortex/isocortex.toml
    systemd-analyze verify --man=no isocortex.service || fail "the unit"
    systemd-analyze security --no-pager isocortex.service | tail -n 1 || true
    dpkg --install "$file" >>"$out/install.txt" 2>&1 || fail "$(tail -n 5 "$out/install.txt")"
    answers
    picture $server "$id" upgraded
    cp /usr/share/doc/isocortex/docs/install.md "$out/"
    documented tokens
    documented check
    tr -d - </proc/sys/kernel/random/uuid >/root/token
    chmod 600 /root/token
    documented credential
    authorization=(-H "Authorization: Bearer $(cat /root/token)")
    answers
    picture $server "$id" token
    [ "$(curl -s -o /dev/null -w '%{http_code}' $server/v1/cases)" = 401 ] || fail "it answers without a token"
    authorization=()
    rm -r /etc/systemd/system/isocortex.service.d
    systemctl daemon-reload
    sed -i 's,^token_file,# token_file,; s,^data = ,date = ,' /etc/isocortex/isocortex.toml
    ! systemctl restart isocortex 2>/dev/null || fail "it restarts with a wrong configuration"
    journalctl -u isocortex --no-pager | grep -q 'unknown field .date.' || fail "the log does not name the wrong setting"
    sed -i 's,^date = ,data = ,' /etc/isocortex/isocortex.toml
    systemctl restart isocortex
    answers
    systemctl stop isocortex
    [ "$(systemctl show -p Result --value isocortex)" = success ] || fail "the service did not end well"
    step "stopped"
    apt-get remove -y isocortex >"$out/remove.txt" 2>&1
    [ ! -e /usr/bin/isocortex ] || fail "the program is left"
    apt-get purge -y isocortex >>"$out/remove.txt" 2>&1
    grep -F 'the store was kept, in /var/lib/isocortex' "$out/remove.txt" || fail "the purge did not name the store"
    [ ! -e /etc/isocortex/isocortex.toml ] || fail "the purge left the configuration"
    [ -e /var/lib/isocortex/rows.sqlite ] || fail "the purge removed the store"
    apt-get install -y --no-install-recommends "$file" >>"$out/install.txt" 2>&1
    answers
    picture $server "$id" kept
    echo 'isocortex isocortex/remove-store boolean true' | debconf-set-selections
    apt-get purge -y isocortex >>"$out/remove.txt" 2>&1
    [ ! -e /var/lib/isocortex ] || fail "the store is left although its removal was asked for"
    # On a machine that has never seen the package.
    userdel isocortex
    rm -r /var/log/isocortex /etc/isocortex /root/token
    documented archive
    answers
    upload /usr/local/share/isocortex/ch2.nii.gz
    picture $server "$id" archive
    systemctl stop isocortex
    ;;
  image)
    token=$(openssl rand -hex 16)
    echo "$token" >"$out/token"
    chmod 644 "$out/token"
    authorization=(-H "Authorization: Bearer $token")
    # As docker/compose.yaml runs it.
    docker run --detach --name isocortex-walk --read-only --tmpfs /tmp:mode=1777,size=64m --cap-drop ALL --security-opt no-new-privileges:true \
      --publish 127.0.0.1:8640:8640 --volume "$out/token:/run/secrets/token:ro" --env ISOCORTEX_TOKEN_FILE=/run/secrets/token \
      --env ISOCORTEX_CREATE=true "$file"
    trap 'docker rm --force --volumes isocortex-walk >/dev/null' EXIT
    docker cp isocortex-walk:/usr/local/share/isocortex/ch2.nii.gz "$out/"
    answers
    upload "$out/ch2.nii.gz"
    picture $server "$id" first
    docker restart isocortex-walk
    answers
    picture $server "$id" restarted
    docker stop isocortex-walk
    ;;
  *) fail "no such kind" ;;
esac
step "removed; done"
