# Puts PyTorch into .libtorch, for processors alone. Sourced by scripts that set `root`, and `work`, an empty folder:
#
#   . "$root/scripts/pytorch.sh"
#
# A Python imports it if it finds the packages of .libtorch, and runs with what is exported here.
#
# PyPI has PyTorch for Linux with CUDA alone, whose libraries take 2 GB. Without a GPU none of their functions is called: empty
# libraries of their names will do, if functions are looked up when they are called.
env -u LIBTORCH -u LIBTORCH_USE_PYTORCH bash "$root/scripts/libtorch.sh"
ldd "$root/.libtorch/torch/lib/libtorch_python.so" | awk '/not found/ { print $1 }' | sort -u | while read -r name; do
    cc -shared -x c /dev/null -o "$work/$name" -Wl,-soname,"$name"
done
echo 'import os, sys; sys.setdlopenflags(os.RTLD_LAZY)' >"$work/sitecustomize.py"
export LD_LIBRARY_PATH=$work PYTHONPATH=$work
