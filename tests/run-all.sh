#!/usr/bin/env bash
# Runs every suite, goes on after a failure so that one run tells everything, and closes with one line: `N passed, N failed`.
# A step that is not itself a count of tests (format, lints, a build) counts only when it fails.
#
# Output goes to the terminal and to target/test-logs/<step>.log; the closing line also to target/test-logs/total.
set -uo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

logs=${CARGO_TARGET_DIR:-target}/test-logs
rm -rf "$logs"
mkdir -p "$logs"
passed=0
failed=0
summary=()

# step NAME FOLDER COMMAND...: runs it, keeps its output, adds up what it counted.
step() {
  local name=$1 folder=$2
  shift 2
  local log=$logs/$name.log started=$SECONDS
  printf '\n== %s: %s\n' "$name" "$*"
  (cd "$folder" && "$@") 2>&1 | tee "$log"
  local status=${PIPESTATUS[0]}
  # nextest: "Summary [ 9.1s] 40 tests run: 38 passed (1 slow), 1 failed, 1 timed out, 0 skipped"
  # cargo test: "test result: ok. 12 passed; 0 failed; ..."; node: "# pass 12" (or with an information sign) and "# fail 0".
  local counts
  counts=$(sed 's/\x1b\[[0-9;]*m//g' "$log" | awk '
    function number_before(word,   at) {
      at = match($0, "[0-9]+ " word)
      return at ? substr($0, RSTART, RLENGTH) + 0 : 0
    }
    /^ *Summary \[/ { p += number_before("passed"); f += number_before("failed") + number_before("timed out") + number_before("exec failed") }
    /^test result: / { p += number_before("passed"); f += number_before("failed") }
    /^(#|ℹ) pass [0-9]+$/ { p += $3 }
    /^(#|ℹ) (fail|cancelled) [0-9]+$/ { f += $3 }
    END { print p + 0, f + 0 }')
  local step_passed=${counts% *} step_failed=${counts#* }
  # A step that fails without naming a failed test did not build, was killed or found a fault of another kind.
  if [ "$status" -ne 0 ] && [ "$step_failed" -eq 0 ]; then step_failed=1; fi
  passed=$((passed + step_passed))
  failed=$((failed + step_failed))
  summary+=("$(printf '%-12s %4d s  %5d passed %4d failed  %s' "$name" $((SECONDS - started)) "$step_passed" "$step_failed" "$log")")
  return "$status"
}

step format . cargo fmt --all --check
# Programs and tests in one call: see the top of the Makefile.
if step build . cargo build --release --locked --workspace --bins --tests; then
  if cargo nextest --version >/dev/null 2>&1; then
    step rust . cargo nextest run --release --locked --workspace --no-fail-fast
  else
    step rust . cargo test --release --locked --workspace --no-fail-fast --lib --bins --tests
  fi
  step client web-client npm test
  step browser tests/browser npm test
fi
step lints . cargo clippy --release --locked --workspace --all-targets -- --deny warnings

printf '\n'
printf '%s\n' "${summary[@]}"
total="$passed passed, $failed failed"
printf '%s\n' "$total" | tee "$logs/total"
[ "$failed" -eq 0 ] && [ "$passed" -gt 0 ]
