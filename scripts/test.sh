#!/usr/bin/env bash
# Runs the checks: `fast` (format, lints, fast unit tests) or `all` (also the integration, documentation and browser tests).
# Every step runs even if an earlier one failed; the last line is a summary. `make lab` checks the laboratory, a workspace of its own.
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/lib.sh"

need_rust
readonly mode=${1:-all}
# A test runs once. The continuous integration repeats a failed one once and names it in the last lines: the next commit mends it.
retries=0
if [ "${CI:-}" = true ]; then
  retries=1
  export NEXTEST_PROFILE=ci
fi
passed=() failed=() skipped=() repeated=() counted=0
log=$(mktemp)
trap 'rm -f "$log"' EXIT

# step NAME COMMAND...: runs the command, shows its output and records the result.
step() {
  local name=$1 started=$SECONDS
  shift
  say "== $name"
  if "$@" 2>&1 | tee "$log"; then
    passed+=("$name")
  else
    failed+=("$name")
  fi
  say "== $name: $((SECONDS - started)) s"
  count_tests
  mapfile -O "${#repeated[@]}" -t repeated < <(sed 's/\x1b\[[0-9;]*m//g' "$log" | grep -aE '^ *FLAKY [0-9]+/|^REPEATED: ' | sort -u)
}

skip() {
  say "== $1: SKIPPED, $2"
  skipped+=("$1")
}

# Adds the number of tests that the last step reports as passed (cargo test, nextest, node and pytest print it differently).
count_tests() {
  local number
  while read -r number; do
    counted=$((counted + number))
  done < <(sed 's/\x1b\[[0-9;]*m//g' "$log" | sed -nE \
    -e 's/^test result: .* ([0-9]+) passed;.*/\1/p' \
    -e 's/^ *Summary .* ([0-9]+) passed.*/\1/p' \
    -e 's/^[#ℹ] pass ([0-9]+)$/\1/p' \
    -e 's/^([0-9]+ failed, )?([0-9]+) passed.* in [0-9].*/\2/p')
}

# with_retries NAME COMMAND...: runs the command, and once more if it fails and a failed test may be repeated.
with_retries() {
  local name=$1
  shift
  "$@" && return
  [ "$retries" != 0 ] || return 1
  say "REPEATED: $name"
  "$@"
}

# rust_tests TARGETS...: uses nextest if it is installed.
rust_tests() {
  if have cargo-nextest; then
    cargo nextest run --locked --no-fail-fast --no-tests=pass "$@"
  else
    cargo test --locked --no-fail-fast "$@"
  fi
}

# The example of each crate's README.
documentation_tests() { cargo test --locked --doc --no-fail-fast; }

# A merge that was committed half done builds as long as the marks lie in documents.
no_conflict_marks() { ! git grep -nE '^(<{7}|>{7})( |$)'; }
shell_scripts() {
  git ls-files -z '*.sh' .ci/run | xargs -0 shellcheck -x
  # The functions of debconf are not of this project.
  shellcheck -e SC1091 scripts/debian/{config,postinst,prerm,postrm}
}
alert_rules() {
  promtool check rules docker/monitoring/alerts.yaml && promtool test rules docker/monitoring/alerts.test.yaml
}
# Neither the program nor its manual need be installed here.
package_unit() { sed 's,^ExecStart=/usr/bin/isocortex,ExecStart=/bin/true,' scripts/debian/isocortex.service >"$unit" && systemd-analyze verify --man=no "$unit"; }

prepared_demo() {
  rm -rf "$ISOCORTEX_PREPARED_DEMO"
  node web/build/browser/prepare.mjs "$ISOCORTEX_PREPARED_DEMO"
}

python_lints() (cd python && "$python" -m ruff check --quiet && "$python" -m ruff format --quiet --check && "$python" -m mypy)
python_tests() {
  ISOCORTEX_BINARY=$(target_dir)/debug/isocortex
  export ISOCORTEX_BINARY
  with_retries "the Python package" "$python" -m pytest --quiet --config-file python/pyproject.toml python
}

page_tests() { npm test --silent --prefix web; }
# browser_test FILE: its output at once, as two run at a time.
browser_test() {
  local output status=0
  output=$(with_retries "$1" node --test "$1" 2>&1) || status=$?
  {
    flock 9
    echo "$output"
  } 9>"$ISOCORTEX_PREPARED_DEMO.lock"
  return "$status"
}
browser_tests() {
  node web/build.mjs tests || return 1
  ISOCORTEX_BINARY=$(target_dir)/debug/isocortex
  # Each file that shows the demo's head begins with a copy of this store.
  ISOCORTEX_PREPARED_DEMO=$(target_dir)/prepared-demo
  export ISOCORTEX_BINARY ISOCORTEX_PREPARED_DEMO
  with_retries "the preparation of the demo's head" prepared_demo || return 1
  # A file keeps one core busy: most of its time its page, its server and the drawing of its pictures wait for one another.
  export retries
  export -f say with_retries browser_test
  printf '%s\n' web/build/browser/*.test.mjs | xargs -P 2 -I FILE bash -c 'browser_test FILE'
}

[ -d "${ISOCORTEX_TEST_DATA:-../shared/data}" ] ||
  skip 'tests on real heads' 'set ISOCORTEX_TEST_DATA to their folder'
# The program embeds the page, so it must be bundled before anything is compiled.
scripts/web.sh
step format cargo fmt --all --check
step "conflict marks" no_conflict_marks
step lints cargo clippy --locked --workspace --all-targets -- -D warnings
if have shellcheck; then step shellcheck shell_scripts; else skip shellcheck "shellcheck is not installed"; fi
if have systemd-analyze; then
  unit=$(mktemp -d)/isocortex.service
  step "package's unit" package_unit
  rm -r "$(dirname "$unit")"
else
  skip "package's unit" "systemd-analyze is not installed"
fi
if hadolint=$(scripts/hadolint.sh 2>/dev/null); then
  step Dockerfile "$hadolint" docker/Dockerfile
else
  skip Dockerfile "hadolint is missing"
fi
if have promtool; then step "rules for Prometheus" alert_rules; else skip "rules for Prometheus" "promtool is not installed"; fi
if have python3 && python3 -c 'import tomllib' 2>/dev/null; then
  step "picture of the crates" scripts/draw-crates.py --check
else
  skip "picture of the crates" "it needs Python 3.11"
fi
if have cargo-deny; then
  step licences cargo deny --offline check bans licenses sources
else
  skip licences "cargo-deny is not installed"
fi
advisories=${ISOCORTEX_ADVISORIES:-../shared/advisories}
if ! [ -e "$advisories" ]; then
  skip advisories "set ISOCORTEX_ADVISORIES to a checkout of the RustSec advisory database"
elif ! { have python3 && python3 -c 'import tomllib' 2>/dev/null; }; then
  skip advisories "they need Python 3.11"
else
  step advisories scripts/advisories.py "$advisories"
fi
python=$(ISOCORTEX_NO_INSTALL=1 scripts/python.sh) || true
if [ "${CI:-}" = true ] || [ -n "$python" ]; then
  step "Python package's lints" python_lints
else
  skip "Python package's lints" "scripts/python.sh fetches what they need"
fi
step "page's format" npm run format --silent --prefix web
step "page's types" npm run types --silent --prefix web
step "page's unit tests" page_tests
step "page's size" node web/sizes.mjs

if [ "$mode" = fast ]; then
  export NEXTEST_PROFILE=fast
  step "unit tests" rust_tests --lib --bins
  step "documentation tests" documentation_tests
else
  # Building the tests and the program in one go gives both the same features.
  step build cargo build --locked --bins --tests
  step tests rust_tests --lib --bins --tests
  step "documentation tests" documentation_tests
  if [ "${CI:-}" = true ] || [ -n "$python" ]; then
    step "Python package" python_tests
  else
    skip "Python package" "it needs the packages that scripts/python.sh fetches"
  fi
  if [ "${CI:-}" = true ] || scripts/chromium.sh >/dev/null; then
    step "browser test" browser_tests
  else
    skip "browser test" "it needs chromium"
  fi
fi

say ""
for name in "${skipped[@]}"; do say "skipped: $name"; done
for name in "${repeated[@]}"; do say "FAILED AT FIRST: $name"; done
for name in "${failed[@]}"; do say "FAILED: $name"; done
say "summary: ${#passed[@]} steps passed, ${#failed[@]} failed, ${#skipped[@]} skipped; $counted tests passed; $SECONDS s"
[ "${#failed[@]}" = 0 ]
