#!/usr/bin/env bash
# Put libtorch into the source tree, and run a command with it:
#
#     bash scripts/libtorch.sh                                             # only fetch it, into .libtorch/
#     bash scripts/libtorch.sh cargo build --release --features torch      # fetch it if need be, and build
#
# An installation that is there is taken instead: LIBTORCH=/path/to/libtorch (the folder with lib/ and include/), or
# LIBTORCH_USE_PYTORCH=1 for the PyTorch of the present Python. The version must be the one below.
set -euo pipefail
version=2.11.0
root=$(cd "$(dirname "$0")/.." && pwd)
own=$root/.libtorch

if [ -z "${LIBTORCH:-}" ] && [ -z "${LIBTORCH_USE_PYTORCH:-}" ]; then
    # Python imports PyTorch only with its manager of shared memory.
    if [ "$(cat "$own/complete" 2>/dev/null)" != "$version" ] || [ ! -e "$own/torch/bin/torch_shm_manager" ]; then
        echo "fetching libtorch $version into $own (about 0.6 GB to load, 1.2 GB on disk)" >&2
        # Whole or not at all, whoever else fetches it meanwhile.
        part=$(mktemp -d "$root/.libtorch-XXXXXX")
        trap 'rm -rf "$part"' EXIT
        chmod 755 "$part"
        # Headers and libraries of PyTorch's package. Of CUDA it wants two libraries even where there is no GPU; the
        # others are used if they are there.
        python3 -m pip install --quiet --disable-pip-version-check --root-user-action=ignore --no-deps --target "$part" \
            "torch==$version" 'nvidia-cuda-cupti==13.0.85.*' 'nvidia-cuda-runtime==13.0.96.*'
        # What only tests and compilers need.
        rm -rf "$part/torch/test" "$part/torch/bin"/{protoc,ptxas}* "$part/functorch"
        echo "$version" > "$part/complete"
        rm -rf "$own"
        mv "$part" "$own"
    fi
    export LIBTORCH=$own/torch
fi
if [ -n "${LIBTORCH:-}" ]; then
    test -d "$LIBTORCH/lib" || { echo "LIBTORCH=$LIBTORCH has no lib/; unset it, or set it to a libtorch" >&2; exit 2; }
    echo "libtorch: $LIBTORCH" >&2
fi
if [ $# -gt 0 ]; then exec "$@"; fi
