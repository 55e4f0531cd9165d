#!/usr/bin/env bash
# Makes everything that is released, in target/dist/: the archive, the wheel, the Debian package, the list of crates and the checksums.
#
#   scripts/dist.sh         build and pack
#   scripts/dist.sh pack    pack the program that was built before
#
# ISOCORTEX_DIST_TARGET names another target than this machine's. All packages hold one tree, target/dist/root, which is laid out like
# /usr: the program finds the weights and the sample head in ../share/isocortex, wherever it is installed.
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/lib.sh"

# The oldest glibc that the program runs on: that of Debian 10, RHEL 8 and the wheels of the tag manylinux_2_28.
readonly GLIBC=2.28
# Of Colin27, unpacked: distributions compress it differently.
readonly HEAD_SHA256=707a360b809ba937f6c007231bcf7dc6e2d33657497b254414c9894b6efa5f8c
readonly PYTHON_TOOLS=(cargo-zigbuild==0.24.0 ziglang==0.17.1)

need_rust
umask 022
target=${ISOCORTEX_DIST_TARGET:-$(rustc -vV | sed -n 's/^host: //p')}
version=$(sed -n 's/^version = "\(.*\)"$/\1/p' Cargo.toml | head -n 1)
dist=$(target_dir)/dist
root=$dist/root
program=$(target_dir)/$target/release/isocortex
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct)
export SOURCE_DATE_EPOCH

# Programs that build against another glibc and put the list of crates into the program.
tools() {
  local folder
  folder=$(target_dir)/dist-tools
  [ -x "$folder/bin/cargo-zigbuild" ] || {
    say "fetching ${PYTHON_TOOLS[*]} into $folder"
    python3 -m venv "$folder" && "$folder/bin/pip" install --quiet "${PYTHON_TOOLS[@]}"
  }
  [ -x "$folder/bin/cargo-auditable" ] || cargo install --quiet --locked --version 0.7.7 --root "$folder" cargo-auditable
  PATH=$folder/bin:$PATH
}

build() {
  tools
  scripts/web.sh
  say "building Isocortex $version for $target"
  ISOCORTEX_BUILD="$(git describe --always --dirty --abbrev=8 --exclude='*') $(git log -1 --format=%cs)"
  # The folders of this machine say nothing about the program.
  RUSTFLAGS="--remap-path-prefix=$PWD=isocortex --remap-path-prefix=${CARGO_HOME:-$HOME/.cargo}=cargo"
  export ISOCORTEX_BUILD RUSTFLAGS CARGO_INCREMENTAL=0 CARGO_PROFILE_RELEASE_STRIP=symbols
  local what=(--release --locked --package isocortex --bin isocortex)
  case $target in
    *-linux-gnu) cargo auditable zigbuild "${what[@]}" --target "$target.$GLIBC" ;;
    *) cargo auditable build "${what[@]}" --target "$target" ;;
  esac
}

# The tree that all packages hold.
stage() {
  local weights head doc=$root/share/doc/isocortex
  weights=$(scripts/network.sh)
  head=$(scripts/head.sh)
  gzip -dc "$head/ch2.nii.gz" | sha256sum | grep -q "^$HEAD_SHA256 " || die "$head/ch2.nii.gz is another head than Colin27 of mricron-data"
  rm -rf "$root"
  mkdir -p "$root/bin" "$root/share/isocortex" "$doc"
  cp "$program" "$root/bin/isocortex"
  cp "$weights" "$head/ch2.nii.gz" "$root/share/isocortex/"
  # Where they are in the checkout, so that their links lead somewhere.
  git ls-files -z README.md SECURITY.md CHANGELOG.md ARCHITECTURE.md CONTRIBUTING.md lab/README.md lab/docs web/README.md tests/faults/README.md fuzz/README.md server/service/src/wire/README.md scripts/example-layers.py LICENSE-MIT LICENSE-APACHE NOTICE docs docker scripts/debian/isocortex.{toml,service} |
    tar -cf - --null -T - | tar -xf - -C "$doc"
  cp "$head/../../doc/mricron-data/copyright" "$doc/COLIN27"
  scripts/sbom.py --licences "$doc/LICENCES-OF-CRATES" "$target"
  # It runs the program, so a package is made on a machine of its own kind.
  "$root/bin/isocortex" manual "$root/share"
  chmod -R u=rwX,go=rX "$root"
  find "$root/share" -type f -exec chmod 644 {} +
}

say "== Isocortex $version for $target"
[ "${1:-}" = pack ] || build
[ -x "$program" ] || die "$program is missing: run scripts/dist.sh without an argument"
mkdir -p "$dist"
rm -f "$dist"/*.{tar.gz,whl,deb,json} "$dist/SHA256SUMS"
stage
scripts/pack.py "$root" "$dist" "$version" "$target"
case $target in *-linux-gnu) scripts/deb.sh "$root" "$dist" "$version" "$target" ;; esac
scripts/sbom.py "$dist/isocortex-$version-$target.cdx.json" "$target"
shopt -s nullglob
cd "$dist"
made=(*.{tar.gz,whl,deb,json})
sha256sum "${made[@]}" >SHA256SUMS
root/bin/isocortex --version
wc -c "${made[@]}" | awk '{ printf "%8.1f MB  %s\n", $1 / 1e6, $2 }'
