#!/bin/sh
# Starts phd; words after it are its arguments: ./phd study --operators 1 --out results
here=$(dirname "$(readlink -f -- "$0")")
unset PYTHONHOME PYTHONPATH
# Libraries of the system that this one lacks come from the folder system.
if ldd "$here"/libraries/PySide6/Qt/plugins/platforms/libqxcb.so "$here"/python/lib/python3*/lib-dynload/*.so \
    2>/dev/null | grep -q 'not found'; then
    export LD_LIBRARY_PATH="$here/system${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}"
fi
exec "$here/python/bin/python3" -m app.cli "$@"
