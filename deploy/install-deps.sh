#!/usr/bin/env bash
# Installs what a bare machine needs to build, run and (with --tests) test surfelcast. Safe to run again: it installs
# only what is missing.
#
#   deploy/install-deps.sh            what `make serve` needs
#   deploy/install-deps.sh --tests    also what `make test` needs: Node, Chromium, the npm packages
#
# Exit status: 0 nothing is missing, 2 something is missing and could not be installed (the message says what to do).
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

for_tests=no
case "${1:-}" in
  "") ;;
  --tests) for_tests=yes ;;
  *) echo "usage: deploy/install-deps.sh [--tests]" >&2; exit 2 ;;
esac

minimum_rust=$(sed -n 's/^rust-version = "\(.*\)"/\1/p' Cargo.toml)
minimum_node=20
packages=() # Debian names of what is missing
reasons=()  # one line for each, for people on other systems
problems=() # what no package manager call of ours can mend

need() { # need PACKAGE REASON
  packages+=("$1")
  reasons+=("$2")
}

has() { command -v "$1" >/dev/null 2>&1; }

# True when version $1 is at least $2.
at_least() { [ "$(printf '%s\n%s\n' "$2" "$1" | sort -V | head -n 1)" = "$2" ]; }

# A driver is registered with the Vulkan loader by a JSON manifest. A machine that has one, of a GPU above all, is left
# alone; Mesa's software driver is only for machines without.
vulkan_driver_present() {
  [ -z "${VK_DRIVER_FILES:-}${VK_ICD_FILENAMES:-}${VK_ADD_DRIVER_FILES:-}" ] || return 0
  local folder
  for folder in /etc /usr/share /usr/local/share /usr/local/etc "${XDG_DATA_HOME:-${HOME:-}/.local/share}"; do
    compgen -G "$folder/vulkan/icd.d/*.json" >/dev/null && return 0
  done
  return 1
}

vulkan_loader_present() {
  # ldconfig is in sbin, which is not on every user's PATH.
  { PATH="$PATH:/usr/sbin:/sbin" ldconfig -p 2>/dev/null || true; } | grep -q 'libvulkan\.so\.1' && return 0
  compgen -G "/usr/lib*/libvulkan.so.1" >/dev/null || compgen -G "/usr/lib/*/libvulkan.so.1" >/dev/null
}

find_chromium() {
  local name
  for name in "${CHROMIUM:-}" chromium chromium-browser google-chrome-stable google-chrome; do
    [ -n "$name" ] && has "$name" && return 0
  done
  return 1
}

# Look.
if ! has cargo; then
  problems+=("Rust $minimum_rust or newer is missing. Install it from https://rustup.rs, then run this again.")
elif ! at_least "$(rustc --version | cut -d' ' -f2)" "$minimum_rust"; then
  problems+=("Rust is $(rustc --version | cut -d' ' -f2), but $minimum_rust or newer is needed: rustup update stable")
elif [ "$for_tests" = yes ]; then
  cargo fmt --version >/dev/null 2>&1 || problems+=("rustfmt is missing: rustup component add rustfmt")
  cargo clippy --version >/dev/null 2>&1 || problems+=("clippy is missing: rustup component add clippy")
fi
has cc || need build-essential "a C compiler, linker and headers (build-essential): links Rust programs, builds the image encoders"
has cmake || need cmake "cmake: configures libjpeg-turbo"
has nasm || need nasm "nasm: assembles libjpeg-turbo's SIMD code, without which JPEG is several times slower"
vulkan_loader_present || need libvulkan1 "the Vulkan loader (libvulkan.so.1)"
vulkan_driver_present || need mesa-vulkan-drivers "a Vulkan driver: your GPU vendor's, or Mesa's software driver lavapipe (mesa-vulkan-drivers)"
if [ "$for_tests" = yes ]; then
  find_chromium || need chromium "Chromium (or set CHROMIUM to its path): the browser tests drive it"
  if ! has node; then
    # The distribution's Node is used only if it is new enough: Debian 12, for example, has 18.
    candidate=$({ apt-cache policy nodejs 2>/dev/null || true; } | sed -n 's/^ *Candidate: \([0-9.]*\).*/\1/p')
    if [ -n "$candidate" ] && ! at_least "$candidate" "$minimum_node"; then
      problems+=("Node $minimum_node or newer is missing (this system packages $candidate): https://nodejs.org/en/download")
    else
      need nodejs "Node $minimum_node or newer: runs the browser client's tests"
      has npm || need npm "npm: fetches the test tools of the browser client"
    fi
  elif ! has npm; then
    need npm "npm: fetches the test tools of the browser client"
  fi
fi

# Install.
if [ ${#packages[@]} -gt 0 ]; then
  as_root=()
  if [ "$(id -u)" -ne 0 ]; then
    if has sudo && sudo -n true 2>/dev/null; then as_root=(sudo -n); else as_root=(none); fi
  fi
  if ! has apt-get; then
    problems+=("These are missing, and this script installs only on Debian and Ubuntu; use your system's packages for:")
    for reason in "${reasons[@]}"; do problems+=("  - $reason"); done
  elif [ "${as_root[0]:-}" = none ]; then
    problems+=("These packages are missing and need root to install. Run:")
    problems+=("  sudo apt-get update && sudo apt-get install --yes --no-install-recommends ${packages[*]}")
  else
    echo "Installing: ${packages[*]}"
    apt=("${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get --quiet --option=Dpkg::Use-Pty=0)
    # A package list that cannot be updated may suffice; the installation below decides.
    "${apt[@]}" update || echo "apt-get update failed; trying with the lists at hand" >&2
    if ! "${apt[@]}" install --yes --no-install-recommends "${packages[@]}"; then
      problems+=("apt-get could not install: ${packages[*]} (its own message is above)")
    fi
  fi
fi

# For `make test`: a Node that is new enough, and the packages of the lock files.
if [ "$for_tests" = yes ] && has node; then
  node_version=$(node --version | tr -d v)
  at_least "$node_version" "$minimum_node" ||
    problems+=("Node is $node_version, but $minimum_node or newer is needed: https://nodejs.org/en/download")
  if [ ${#problems[@]} -eq 0 ]; then
    for folder in web-client tests/browser; do
      installed=$folder/node_modules/.package-lock.json
      if [ ! -e "$installed" ] || [ "$folder/package-lock.json" -nt "$installed" ]; then
        echo "Fetching the npm packages of $folder"
        if (cd "$folder" && npm ci --no-audit --no-fund --loglevel=error); then
          touch "$installed"
        else
          problems+=("npm ci failed in $folder (its own message is above)")
        fi
      fi
    done
  fi
fi

if [ ${#problems[@]} -gt 0 ]; then
  echo "surfelcast needs more than this machine has:" >&2
  printf '%s\n' "${problems[@]}" >&2
  exit 2
fi
