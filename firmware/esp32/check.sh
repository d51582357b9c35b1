#!/bin/sh
# Checks syntax and types of this folder against the stubs: CXX=g++ firmware/esp32/check.sh
set -eu
cd "$(dirname "$0")"
for source in *.cpp; do
  "${CXX:-c++}" -fsyntax-only -std=c++17 -Wall -Wextra -Wconversion -Werror -isystem ../stubs "$source"
done
