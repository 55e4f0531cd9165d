#!/usr/bin/env bash
# Installs what is needed besides a Rust toolchain, Node and make: for building (argument: build), for building and testing (test),
# or for these and the demo's head (all). Reports what cannot be installed, and fails only if it is indispensable.
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/lib.sh"

need_rust

# The bundled SQLite is C, and rustc links with cc.
compiler() {
  have cc || install_packages gcc libc6-dev || die "a C compiler (cc) is missing; install gcc."
}

browser() {
  scripts/chromium.sh >/dev/null && return 0
  install_packages chromium ||
    say "the browser test needs the Debian package chromium; without it that test is skipped (on CI it fails)."
}

# A software graphics device, so that the GPU renderers are tested on machines without a GPU.
graphics() {
  ls /usr/share/vulkan/icd.d/*.json /etc/vulkan/icd.d/*.json >/dev/null 2>&1 && return 0
  install_packages libvulkan1 mesa-vulkan-drivers ||
    say "the tests of the graphics renderers need the Debian packages libvulkan1 and mesa-vulkan-drivers; without them these tests are skipped (on CI they fail)."
}

# The tests of rows start their own PostgreSQL servers.
database() {
  if compgen -G '/usr/lib/postgresql/*/bin/initdb' >/dev/null || have initdb || [ -n "${ISOCORTEX_POSTGRES:-}" ]; then
    return 0
  fi
  install_packages postgresql ||
    say "the tests of PostgreSQL need the Debian package postgresql; without it these tests are skipped (on CI they fail)."
}

# An S3-compatible store, which the tests of objects start.
object_store() {
  scripts/weed.sh >/dev/null ||
    say "the tests of S3 need SeaweedFS, which is missing; without it these tests are skipped (on CI they fail)."
}

# Programs that send images to us, and that check and read the objects that we make.
dicom_tools() {
  { have dciodvfy && have storescu; } || install_packages dcmtk dicom3tools ||
    say "the tests with other DICOM software need the Debian packages dcmtk and dicom3tools; without them these tests are skipped (on CI they fail)."
  target/python/bin/python -c 'import highdicom' 2>/dev/null ||
    { python3 -m venv target/python && target/python/bin/pip install --quiet highdicom; } >/dev/null 2>&1 ||
    say "a test reads our segmentations with the Python package highdicom, which is missing; it is skipped (on CI it fails)."
  target/python/bin/python -c 'import sqlalchemy, pynetdicom' 2>/dev/null ||
    { python3 -m venv target/python && target/python/bin/pip install --quiet pynetdicom sqlalchemy; } >/dev/null 2>&1 ||
    say "a test works with the archive of the Python package pynetdicom, which is missing; it is skipped (on CI it fails)."
  target/python/bin/python -c 'import openapi_spec_validator, prometheus_client' 2>/dev/null ||
    { python3 -m venv target/python && target/python/bin/pip install --quiet openapi-spec-validator prometheus-client; } >/dev/null 2>&1 ||
    say "tests check the description of the interface and the metrics with the Python packages openapi-spec-validator and prometheus-client, which are missing; they are skipped (on CI they fail)."
}

# without_service SERVICE PACKAGES...: installs packages that start a service and let it start with the machine: a policy of
# invoke-rc.d(8), which is removed again, prevents the first, and the service is disabled.
without_service() {
  local service=$1 right policy=/usr/sbin/policy-rc.d
  shift
  (
    right=$(install_right) || true
    # $right is one or more words, split on purpose.
    # shellcheck disable=SC2086
    if [ -n "$right" ]; then
      if [ ! -e "$policy" ]; then
        trap '$right rm -f "$policy"' EXIT
        printf '#!/bin/sh\nexit 101\n' | $right tee "$policy" >/dev/null
        $right chmod 755 "$policy"
      fi
      install_packages "$@" && $right update-rc.d "$service" disable >/dev/null 2>&1
    fi
  ) || true
}

# Orthanc, a PACS.
orthanc() {
  local plugins=/usr/share/orthanc/plugins
  [ -x /usr/sbin/Orthanc ] && [ -e $plugins/libOrthancDicomWeb.so ] && [ -e $plugins/libOrthancPython.so ] && return 0
  without_service orthanc orthanc orthanc-dicomweb orthanc-python
  [ -x /usr/sbin/Orthanc ] ||
    say "the tests with Orthanc need the Debian packages orthanc, orthanc-dicomweb and orthanc-python; without them these tests are skipped (on CI they fail)."
}

# promtool, which checks the rules for Prometheus, comes with a server.
monitoring() {
  have promtool && return 0
  without_service prometheus prometheus
  have promtool ||
    say "the rules for Prometheus are checked by promtool of the Debian package prometheus; without it that check is skipped."
}

# A proxy, and the schemas of Kubernetes with a reader of YAML, for the tests of several servers.
deployment() {
  scripts/caddy.sh >/dev/null ||
    say "the tests behind a proxy need Caddy, which is missing; without it these tests are skipped."
  scripts/kubernetes.sh >/dev/null ||
    say "the tests of the files for Docker and Kubernetes need kubernetes-validate, which is missing; without it these tests are skipped."
}

# Reads the words of the reports that are printed.
pdf_reader() {
  have pdftotext || install_packages poppler-utils ||
    say "a test reads a report as PDF with pdftotext of the Debian package poppler-utils, which is missing; it is skipped (on CI it fails)."
}

# What lints and tests the Python package.
python_package() {
  scripts/python.sh >/dev/null ||
    say "the tests of the Python package need packages that are missing; without them these tests are skipped (on CI they fail)."
}

# The weights of the network that extracts brains.
network() {
  scripts/network.sh >/dev/null ||
    say "the network's weights are not available; tree pruning will extract brains, and the tests of the network are skipped."
}

head_of_demo() {
  [ -n "${ISOCORTEX_DEMO_VOLUME:-}" ] || scripts/head.sh >/dev/null ||
    say "no real head is available; the demo will use a synthetic head."
}

case "${1:-all}" in
  build) compiler ;;
  test) compiler; browser; graphics; database; object_store; dicom_tools; pdf_reader; orthanc; monitoring; deployment; python_package; network ;;
  all) compiler; browser; graphics; database; object_store; dicom_tools; pdf_reader; orthanc; monitoring; deployment; python_package; network; head_of_demo ;;
  *) die "usage: scripts/setup.sh [build|test|all]" ;;
esac
