#!/bin/sh
# For make: brings the virtual environment up to date. It is made, or made anew if it cannot serve; then the package
# is installed. Only what make itself made is ever deleted.
# Argument: the package's extras ("" or "[dev,cluster,export,sumo]"). Environment: VENV; PYTHON; PYTHON_GIVEN, not empty if
# PYTHON is somebody's choice and not the default.
set -eu

NEEDED=$(sed -n 's/^requires-python = ">=\(.*\)"$/\1/p' pyproject.toml)
case $VENV in /*) ;; *) VENV=./$VENV ;; esac # a name that begins with - is no option
case ${OS:-} in Windows_NT) BIN=$VENV/Scripts ;; *) BIN=$VENV/bin ;; esac

fail() {
  printf 'setup: %s\n' "$*" >&2
  exit 1
}

# Version of a Python, like 3.11.7; nothing if it does not run. Python 2 tells it on stderr.
version_of() { "$1" --version 2>&1 | sed -n 's/^Python \([0-9][0-9.]*\).*/\1/p' | head -n 1; }

minor_of() { echo "$1" | cut -d . -f 1,2; }

# Whether a version, compared by its first two numbers, is NEEDED or later.
is_fit() { [ -n "$1" ] && [ "$(printf '%s\n' "$(minor_of "$1")" "$NEEDED" | sort -t . -k 1,1n -k 2,2n | head -n 1)" = "$NEEDED" ]; }

# Ends with one line if PYTHON is not found or too old.
check_python() {
  command -v "$PYTHON" >/dev/null 2>&1 || fail "$PYTHON: not found; needed: Python >= $NEEDED, given as PYTHON=...$(another)"
  wanted=$(version_of "$PYTHON")
  [ -n "$wanted" ] || fail "$PYTHON: does not run as a Python; needed: Python >= $NEEDED, given as PYTHON=...$(another)"
  is_fit "$wanted" || fail "$PYTHON is Python $wanted; needed: >= $NEEDED, given as PYTHON=...$(another)"
}

# Another Python of this machine that would do, as an end of a sentence.
another() {
  for name in python3.13 python3.12 python3.11 python3; do
    if is_fit "$(version_of "$name")"; then
      echo " (there is PYTHON=$name)"
      return
    fi
  done
}

is_made_by_make() {
  [ -e "$VENV/.made-by-make" ] || { [ "$VENV" = ./.venv ] && ! [ -L "$VENV" ] && [ -f "$VENV/pyvenv.cfg" ]; }
}

# Where the environment lies: a copied or moved one still runs what lies where it came from.
place() { (cd "$VENV" && pwd -P); }

is_fresh() {
  [ -e "$STAMP" ] && [ -x "$BIN/highd-lc" ] && ! [ pyproject.toml -nt "$STAMP" ] && ! [ constraints.txt -nt "$STAMP" ]
}

has_pip() { "$BIN/python" -m pip --version >/dev/null 2>&1; }

# Why the environment cannot serve, in words; nothing if it can.
fault_of_venv() {
  if ! [ -f "$VENV/pyvenv.cfg" ]; then
    echo "it is not a virtual environment"
    return
  fi
  found=$(version_of "$BIN/python")
  made=$(sed -n 's/^version\(_info\)\{0,1\} *= *\([0-9][0-9.]*\).*/\2/p' "$VENV/pyvenv.cfg" | head -n 1)
  if [ -z "$found" ]; then
    echo "its python does not run"
  elif ! is_fit "$found"; then
    echo "it is of Python $found (needed: >= $NEEDED)"
  elif [ -n "$made" ] && [ "$(minor_of "$made")" != "$(minor_of "$found")" ]; then
    echo "it was made for Python $made, its python is $found now"
  elif [ -n "$PYTHON_GIVEN" ] && [ "$(minor_of "$wanted")" != "$(minor_of "$found")" ]; then
    echo "it is of Python $found, asked for is $wanted"
  elif [ -s "$VENV/.set-up" ] && [ "$(cat "$VENV/.set-up")" != "$(place)" ]; then
    echo "it was made elsewhere"
  elif ! is_fresh && ! has_pip && ! { "$BIN/python" -m ensurepip >/dev/null 2>&1 && has_pip; }; then
    echo "it has no pip"
  fi
}

make_venv() {
  "$PYTHON" -c 'import ensurepip, venv' >/dev/null 2>&1 ||
    fail "$PYTHON (Python $wanted) lacks ensurepip or venv; on Debian and Ubuntu: apt install python$(minor_of "$wanted")-venv; or give another PYTHON=..."
  "$PYTHON" -m venv --clear "$VENV"
  touch "$VENV/.made-by-make"
}

prepare_venv() {
  if [ -L "$VENV" ] && ! [ -e "$VENV" ]; then fail "VENV=$VENV: a link to nowhere"; fi
  if [ -z "$(find "$VENV/" ! -type d 2>/dev/null | head -n 1)" ] && ! [ -f "$VENV" ]; then
    check_python
    make_venv
    return
  fi
  [ -z "$PYTHON_GIVEN" ] || check_python
  fault=$(fault_of_venv)
  [ -n "$fault" ] || return 0
  # A folder with a stamp and the command that is no virtual environment: a prefix that somebody else keeps in order.
  if is_fresh && ! [ -f "$VENV/pyvenv.cfg" ] && ! is_made_by_make; then return 0; fi
  is_made_by_make || fail "VENV=$VENV: $fault, and make did not make it: remove it, or give another VENV"
  check_python
  printf 'setup: %s\n' "$VENV: $fault; making it anew with $PYTHON (Python $wanted)"
  make_venv
}

install_package() {
  printf 'setup: %s\n' "installing the package and what it needs into $VENV, a minute or two" >&2
  "$BIN/python" -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable ".$1"
  place >"$VENV/.set-up"
  [ -z "$1" ] || cp "$VENV/.set-up" "$STAMP"
}

STAMP=$VENV/.set-up${1:+-dev}
prepare_venv
is_fresh || install_package "$1"
