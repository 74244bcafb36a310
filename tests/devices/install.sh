#!/bin/sh
# Audio servers for the tests of devices, where this may install them: as root, or with sudo without a password.
# Quiet, quick when all is there, and never a failure: what is missing, its tests skip with a reason.
PACKAGES="jackd2 libjack-jackd2-0 libportaudio2 pulseaudio pulseaudio-utils libasound2-plugins alsa-utils"
here() { command -v jackd && command -v pulseaudio && command -v parec && dpkg -s libportaudio2 libasound2-plugins; }
here >/dev/null 2>&1 && exit 0
command -v apt-get >/dev/null 2>&1 || exit 0
if [ "$(id -u)" = 0 ]; then SUDO=; elif sudo -n true 2>/dev/null; then SUDO="sudo -n"; else exit 0; fi
echo "Installing the audio servers that the tests of devices use: $PACKAGES"
export DEBIAN_FRONTEND=noninteractive
install() { $SUDO env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends $PACKAGES; }
{ install || { $SUDO apt-get update -q && install; }; } >/dev/null 2>&1 || echo "They could not be installed: those tests are skipped."
exit 0
