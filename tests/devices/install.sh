#!/bin/sh
# Audio servers for the tests of devices, and a browser for those of the live page, where this may install them: as root, or with
# sudo without a password; and the programs that the command line names. Quiet, quick when all is there, and never a failure: what is
# missing, its tests skip with a reason.
SERVERS="jackd2 libjack-jackd2-0 libportaudio2 pulseaudio pulseaudio-utils libasound2-plugins alsa-utils"
BROWSER="chromium"
servers() { command -v jackd && command -v pulseaudio && command -v parec && dpkg -s libportaudio2 libasound2-plugins; }
browser() { command -v chromium || command -v chromium-browser || command -v google-chrome; }
PACKAGES=
servers >/dev/null 2>&1 || PACKAGES="$SERVERS"
browser >/dev/null 2>&1 || PACKAGES="$PACKAGES $BROWSER"
for name in "$@"; do command -v "$name" >/dev/null || PACKAGES="$PACKAGES $name"; done
[ -n "$PACKAGES" ] && command -v apt-get >/dev/null 2>&1 || exit 0
if [ "$(id -u)" = 0 ]; then SUDO=; elif sudo -n true 2>/dev/null; then SUDO="sudo -n"; else exit 0; fi
echo "Installing what tests of devices and of the live page use: $PACKAGES"
install() { $SUDO env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends "$@"; }
{ install $PACKAGES || { $SUDO apt-get update -q && install $PACKAGES; } || install $SERVERS; } >/dev/null 2>&1 \
  || echo "They could not be installed: those tests are skipped."
exit 0
