#!/usr/bin/env bash
# Runs every suite. Continues after a failure, so that one run reports everything, and ends with one line:
# `N passed, N failed, N skipped`. A step that is not a suite (format, lints, a build) counts only when it fails.
#
# A test that lacks what it compares with, such as the reference images, prints `skipped: REASON` and returns. It is
# counted as skipped, so that a run without references differs from one with them.
#
# Output goes to the terminal and to target/test-logs/<step>.log; the closing line also to target/test-logs/total.
set -uo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

target=${CARGO_TARGET_DIR:-target}
logs=$target/test-logs
# nextest keeps its own folder in the workspace.
junit=target/nextest/default/junit.xml
rm -rf "$logs" "$junit"
mkdir -p "$logs"
passed=0
failed=0
skipped=0
summary=()

# Each of these reads the log of a step and prints "passed failed skipped".
count_none() { echo 0 0 0; }

# nextest writes a report (.config/nextest.toml): totals in the root element, the output of every test in its own.
count_junit() {
  [ -s "$junit" ] || { echo 0 0 0; return; }
  awk '
    function value(name) {
      return match($0, " " name "=\"[0-9]+\"") ? substr($0, RSTART + length(name) + 3) + 0 : 0
    }
    /<testsuites / { tests = value("tests"); failed = value("failures") + value("errors") }
    /<testcase / { is_counted = 0 }
    /(^|>)skipped: / && !is_counted { is_counted = 1; skipped++ }
    END { print tests - failed - skipped, failed + 0, skipped + 0 }' "$junit"
}

# cargo test: "test result: ok. 12 passed; 0 failed; ...", and the output of each test after "---- NAME stdout ----".
count_cargo() {
  awk '
    /^test result: / { passed += $4; failed += $6 }
    /^---- / { is_counted = 0 }
    /^skipped: / && !is_counted { is_counted = 1; skipped++ }
    END { print passed - skipped, failed + 0, skipped + 0 }' "$1"
}

# node: "# pass 12" (or with an information sign), "# fail 0", "# cancelled 0", "# skipped 0".
count_node() {
  awk '
    /^(#|ℹ) pass [0-9]+$/ { passed += $3 }
    /^(#|ℹ) (fail|cancelled) [0-9]+$/ { failed += $3 }
    /^(#|ℹ) skipped [0-9]+$/ { skipped += $3 }
    END { print passed + 0, failed + 0, skipped + 0 }' "$1"
}

# step NAME FOLDER COUNT COMMAND...: runs it, keeps its output, adds what count_COUNT finds in it.
step() {
  local name=$1 folder=$2 count=$3
  shift 3
  local log=$logs/$name.log started=$SECONDS
  printf '\n== %s: %s\n' "$name" "$*"
  (cd "$folder" && "$@") 2>&1 | tee "$log"
  local status=${PIPESTATUS[0]} step_passed step_failed step_skipped
  read -r step_passed step_failed step_skipped < <("count_$count" "$log")
  # A step that fails without a failed test did not build, was killed or found a fault of another kind.
  if [ "$status" -ne 0 ] && [ "$step_failed" -eq 0 ]; then step_failed=1; fi
  passed=$((passed + step_passed))
  failed=$((failed + step_failed))
  skipped=$((skipped + step_skipped))
  summary+=("$(printf '%-12s %4d s  %5d passed %4d failed %4d skipped  %s' \
    "$name" $((SECONDS - started)) "$step_passed" "$step_failed" "$step_skipped" "$log")")
  return "$status"
}

step format . none cargo fmt --all --check
# Programs and tests in one call: see the top of the Makefile.
if step build . none cargo build --release --locked --workspace --bins --tests; then
  if cargo nextest --version >/dev/null 2>&1; then
    step rust . junit cargo nextest run --release --locked --workspace --no-fail-fast
  else
    step rust . cargo cargo test --release --locked --workspace --no-fail-fast --lib --bins --tests -- --show-output
  fi
  step client web-client node npm test
  step browser tests/browser node npm test
fi
step lints . none cargo clippy --release --locked --workspace --all-targets -- --deny warnings
step docs . none env RUSTDOCFLAGS="--deny warnings" cargo doc --release --locked --workspace --no-deps

printf '\n'
printf '%s\n' "${summary[@]}"
total="$passed passed, $failed failed, $skipped skipped"
printf '%s\n' "$total" | tee "$logs/total"
[ "$failed" -eq 0 ] && [ "$passed" -gt 0 ]
