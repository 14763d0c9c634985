#!/usr/bin/env bash
# Installs programs of another Debian, with its own libraries, into a folder. Needs root.
#   chroot.sh FOLDER SUITE PROGRAM PACKAGE…
# FOLDER/run-PROGRAM then starts /usr/bin/PROGRAM, FOLDER/enter any other program of the folder; both see /tmp, and the folders in ANYFACE_SEES.
set -euo pipefail
folder=$(realpath -m "$1")
suite=$2
program=$3
shift 3
if [ ! -x "$folder/enter" ]; then
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
fi
cat > "$folder/run-$program" <<END
#!/bin/sh
exec "$folder/enter" /usr/bin/$program "\$@"
END
cat > "$folder/enter.new" <<END
#!/bin/sh
# Folders besides /tmp that programs see stand in ANYFACE_SEES, divided by colons.
exec unshare --mount sh -c '
  mount --bind /tmp "$folder/tmp" && mount --bind /dev "$folder/dev" &&
    mount -t proc proc "$folder/proc" || exit 1
  IFS=:
  for seen in \$ANYFACE_SEES; do
    mkdir -p "$folder\$seen" && mount --bind "\$seen" "$folder\$seen" || exit 1
  done
  unset IFS
  exec chroot "$folder" sh -c "cd \"\\\$0\" 2>/dev/null; exec \"\\\$@\"" "\$PWD" "\$@"' enter "\$@"
END
chmod +x "$folder/run-$program" "$folder/enter.new"
# Other tests may start it at this moment.
mv "$folder/enter.new" "$folder/enter"
