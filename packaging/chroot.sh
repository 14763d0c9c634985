#!/usr/bin/env bash
# Installs programs of another Debian, with its own libraries, into a folder. Needs root.
#   chroot.sh FOLDER SUITE PROGRAM PACKAGE…
# FOLDER/run-PROGRAM then starts /usr/bin/PROGRAM, FOLDER/enter any other program of the folder; both see /tmp.
set -euo pipefail
folder=$(realpath -m "$1")
suite=$2
program=$3
shift 3
if [ -x "$folder/enter" ]; then exit 0; fi
rm -rf "$folder"
mkdir -p "$folder"
mirror=$(sed -n 's/^URIs: *//p; s/^deb \(\[[^]]*\] \)\?\([^ ]*\) .*/\2/p' \
  /etc/apt/sources.list.d/*.sources /etc/apt/sources.list 2>/dev/null \
  | grep -v security | head -n 1 || true)
# An older debootstrap does not know a newer suite; all are set up alike.
debootstrap --variant=minbase --no-check-gpg "$suite" "$folder" "${mirror:-http://deb.debian.org/debian}" \
  /usr/share/debootstrap/scripts/sid
cp /etc/resolv.conf "$folder/etc/resolv.conf"
cp -a /etc/apt/apt.conf.d/. "$folder/etc/apt/apt.conf.d/" 2>/dev/null || true
chroot "$folder" env DEBIAN_FRONTEND=noninteractive sh -c '
  apt-get update -qq
  apt-get install -y -qq --no-install-recommends "$@"
  apt-get clean' install "$@"
cat > "$folder/run-$program" <<END
#!/bin/sh
exec "$folder/enter" /usr/bin/$program "\$@"
END
cat > "$folder/enter" <<END
#!/bin/sh
exec unshare --mount sh -c '
  mount --bind /tmp "$folder/tmp" && mount --bind /dev "$folder/dev" &&
    mount -t proc proc "$folder/proc" || exit 1
  exec chroot "$folder" "\$@"' enter "\$@"
END
chmod +x "$folder/run-$program" "$folder/enter"
