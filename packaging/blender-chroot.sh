#!/usr/bin/env bash
# Debian 12 has no Blender that knows extensions: installs Debian 13's, with its own libraries,
# into a folder, and a display of its own. Needs root. Usage: blender-chroot.sh FOLDER
# FOLDER/run-blender then starts it, FOLDER/enter any other program of the folder; both see /tmp.
set -euo pipefail
folder=$(realpath -m "$1")
if [ -x "$folder/enter" ]; then exit 0; fi
rm -rf "$folder"
mkdir -p "$folder"
mirror=$(sed -n 's/^URIs: *//p; s/^deb \(\[[^]]*\] \)\?\([^ ]*\) .*/\2/p' \
  /etc/apt/sources.list.d/*.sources /etc/apt/sources.list 2>/dev/null \
  | grep -v security | head -n 1 || true)
debootstrap --variant=minbase --no-check-gpg trixie "$folder" "${mirror:-http://deb.debian.org/debian}"
cp /etc/resolv.conf "$folder/etc/resolv.conf"
cp -a /etc/apt/apt.conf.d/. "$folder/etc/apt/apt.conf.d/" 2>/dev/null || true
chroot "$folder" env DEBIAN_FRONTEND=noninteractive sh -c '
  apt-get update -qq
  apt-get install -y -qq --no-install-recommends blender python3-numpy \
    xvfb libgl1-mesa-dri xdotool imagemagick
  apt-get clean'
cat > "$folder/run-blender" <<END
#!/bin/sh
exec "$folder/enter" /usr/bin/blender "\$@"
END
cat > "$folder/enter" <<END
#!/bin/sh
exec unshare --mount sh -c '
  mount --bind /tmp "$folder/tmp" && mount --bind /dev "$folder/dev" &&
    mount -t proc proc "$folder/proc" || exit 1
  exec chroot "$folder" "\$@"' enter "\$@"
END
chmod +x "$folder/run-blender" "$folder/enter"
