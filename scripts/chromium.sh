#!/bin/sh
# Prints the path of a Chromium to test with (CHROMIUM, else the first one found); fails where there is none.
for name in "${CHROMIUM:-}" chromium chromium-browser google-chrome-stable google-chrome; do
  [ -n "$name" ] && command -v "$name" && exit 0
done
exit 1
