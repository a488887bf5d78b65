#!/usr/bin/env bash
# Prove the set-up: `make test` and `make demo` of the last commit in an empty root of this machine's release
# that holds nothing but the packages the README asks for, then `pip install .` in an empty environment.
# With an argument, that command alone: `scripts/fresh.sh "make check"`.
#
# How this machine reaches apt and pip (sources, indexes, proxies, certificates) is copied into the root.
set -euo pipefail
cd "$(dirname "$0")/.."

PACKAGES=python3,python3-venv,build-essential,make,git,ca-certificates

if [ "$(id -u)" != 0 ]; then
    echo "make fresh: needs root, for debootstrap and chroot: sudo make fresh" >&2
    exit 1
fi
if ! command -v debootstrap >/dev/null; then
    echo "make fresh: debootstrap is missing: apt-get install -y debootstrap" >&2
    exit 1
fi
if [ -z "${COSLOBE_FRESH:-}" ]; then # the mounts below end with this namespace, whatever happens
    COSLOBE_FRESH=1 exec unshare --mount --propagation private scripts/fresh.sh "$@"
fi

root=$(mktemp -d "${TMPDIR:-/tmp}/coslobe-fresh-XXXXXX")
chmod 755 "$root"
trap 'cd /; umount -R -l "$root"/{proc,sys,dev/shm,dev/pts} 2>/dev/null; rm -rf --one-file-system "$root"' EXIT

suite=$(. /etc/os-release && echo "$VERSION_CODENAME")
targets=$(apt-get indextargets --format '$(CODENAME) $(REPO_URI) $(COMPONENT)' 'Created-By: Packages')
mirror=$(awk -v suite="$suite" '$1 == suite { print $2; exit }' <<<"$targets")
components=$(awk -v suite="$suite" '$1 == suite && !seen[$3]++ { print $3 }' <<<"$targets" | paste -sd,)
echo "== empty root: $suite with $PACKAGES"
debootstrap --variant=minbase --components="$components" --include="$PACKAGES" "$suite" "$root" "$mirror" >"$root.log" ||
    { tail "$root.log" >&2; exit 1; }
rm "$root.log"

rm -f "$root/etc/apt/sources.list"
copy() { # a file or folder of this machine to the same place in the root, where it exists
    if [ -e "$1" ]; then
        mkdir -p "$root$(dirname "$1")"
        cp -aL "$1" "$root$(dirname "$1")/"
    fi
}
for path in /etc/resolv.conf /etc/hosts /etc/pip.conf /etc/ssl/certs/ca-certificates.crt \
    /etc/apt/sources.list /etc/apt/sources.list.d /etc/apt/auth.conf.d /etc/apt/keyrings /usr/share/keyrings; do
    copy "$path"
done
apt-config dump Acquire >"$root/etc/apt/apt.conf.d/00acquire"
for file in .config/pip/pip.conf .pip/pip.conf; do
    [ -e "$HOME/$file" ] && install -D -m 600 "$HOME/$file" "$root/root/$file"
done
mapfile -t passed < <(env | grep -iE '^(PIP_[A-Z_]+|https?_proxy|no_proxy|SSL_CERT_(FILE|DIR)|[A-Z]+_CA_BUNDLE)=')
for variable in "${passed[@]}"; do
    case $variable in *CERT*=/* | *CA_BUNDLE=/*) [ -f "${variable#*=}" ] && copy "${variable#*=}" ;; esac
done

mount -t proc proc "$root/proc"
mount --rbind /sys "$root/sys" # PoCL reads the CPU's topology there
mkdir -p "$root"/dev/{shm,pts}
mount -t tmpfs tmpfs "$root/dev/shm"
mount -t devpts devpts "$root/dev/pts"
git clone -q --no-hardlinks . "$root/root/coslobe"

inside() {
    echo "== $1"
    time chroot "$root" env -i HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin LANG=C.UTF-8 "${passed[@]}" \
        bash -c "cd /root/coslobe && $1"
}
if [ $# -gt 0 ]; then
    inside "$*"
    exit
fi
inside "make test"
inside "make demo"
inside "make prepare" # a second time: nothing to do
empty=/opt/empty/bin
inside "python3 -m venv /opt/empty && $empty/pip install -q . && cd / && $empty/coslobe --version && $empty/coslobe devices"
echo "== all passed"
