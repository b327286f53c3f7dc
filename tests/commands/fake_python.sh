#!/bin/sh
# Acts as a Python of the version in the file `version` beside it, as far as tools/set_up.sh asks: makes
# environments, has pip unless a file `no-pip` lies beside it, ensurepip unless `no-ensurepip`; install makes a
# highd-lc that prints its arguments.
here=$(dirname "$0")
case "$*" in
--version) echo "Python $(cat "$here/version")" ;;
"-c "*ensurepip*) ! [ -e "$here/no-ensurepip" ] ;;
"-m ensurepip") ! [ -e "$here/no-ensurepip" ] && rm -f "$here/no-pip" ;;
"-m pip --version") ! [ -e "$here/no-pip" ] ;;
"-m venv --clear "*)
  rm -rf "$4"
  mkdir -p "$4/bin"
  cp "$here/version" "$here/fake_python.sh" "$4/bin"
  ln -s fake_python.sh "$4/bin/python"
  echo "version = $(cat "$here/version")" >"$4/pyvenv.cfg"
  ;;
"-m pip install "*)
  printf '#!/bin/sh\nfor one; do printf "<%%s>" "$one"; done\n' >"$here/highd-lc"
  chmod +x "$here/highd-lc"
  echo "installed $*"
  ;;
*) exit 9 ;;
esac
