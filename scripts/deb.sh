#!/usr/bin/env bash
# Makes the Debian package of a tree that dist.sh has laid out:  scripts/deb.sh ROOT FOLDER VERSION TARGET
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/lib.sh"

readonly root=$1 folder=$2 version=$3
case $4 in
  x86_64-*) architecture=amd64 ;;
  aarch64-*) architecture=arm64 ;;
  *) die "Debian has no name for $4" ;;
esac
have dpkg-deb || { say "dpkg-deb is missing: no Debian package is made"; exit 0; }
umask 022
tree=$folder/deb
doc=$tree/usr/share/doc/isocortex
rm -rf "$tree"
mkdir -p "$tree/DEBIAN" "$tree/etc/isocortex" "$tree/usr/lib/systemd/system"
cp -R "$root/." "$tree/usr/"
cp scripts/debian/isocortex.toml "$tree/etc/isocortex/"
cp scripts/debian/isocortex.service "$tree/usr/lib/systemd/system/"

# Where Debian's policy wants them, and how.
mv "$tree/usr/share/zsh/site-functions" "$tree/usr/share/zsh/vendor-completions"
maintainer=$(sed -n 's/^Maintainer: //p' scripts/debian/control)
cat >"$doc/changelog" <<EOF
isocortex ($version) unstable; urgency=medium

  * CHANGELOG.md beside this file has the changes.

 -- $maintainer  $(date --utc --rfc-email --date="@$SOURCE_DATE_EPOCH")
EOF
gzip -9n "$doc/changelog" "$tree"/usr/share/man/man1/*
sed -e 's/^$/./' -e 's/^/ /' LICENSE-MIT | sed -e '/@MIT@/{r /dev/stdin' -e 'd}' scripts/debian/copyright >"$doc/copyright"
rm "$doc"/LICENSE-*

for file in config postinst prerm postrm; do install -m 755 "scripts/debian/$file" "$tree/DEBIAN/$file"; done
cp scripts/debian/templates "$tree/DEBIAN/"
echo /etc/isocortex/isocortex.toml >"$tree/DEBIAN/conffiles"
(cd "$tree" && find usr -type f -print0 | LC_ALL=C sort -z | xargs -0 md5sum >DEBIAN/md5sums)
size=$(du -sk --exclude=DEBIAN "$tree" | cut -f1)
sed -e "s/@VERSION@/$version/; s/@ARCHITECTURE@/$architecture/; s/@SIZE@/$size/" scripts/debian/control >"$tree/DEBIAN/control"
chmod -R u=rwX,go=rX "$tree"
dpkg-deb --root-owner-group -Zxz --build "$tree" "$folder/isocortex_${version}_$architecture.deb" >&2
rm -rf "$tree"
