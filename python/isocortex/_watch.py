"""Runs the program until the Python that started it ends:  python _watch.py FOLDER PROGRAM [ARGUMENT...]

That Python holds the other end of standard input. The system closes it when that process ends, in whatever way, and
this one then stops the program and removes FOLDER. If this process is killed, Linux stops the program; FOLDER then
stays.
"""

import contextlib
import ctypes
import os
import shutil
import signal
import subprocess
import sys

PR_SET_PDEATHSIG = 1
PATIENCE_S = 5


def end_with_parent() -> None:
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def main() -> None:
    folder, *command = sys.argv[1:]
    is_linux = sys.platform == "linux"
    # There are no threads here, which would make preexec_fn dangerous.
    server = subprocess.Popen(command, stdin=subprocess.DEVNULL, preexec_fn=end_with_parent if is_linux else None)
    # So that whoever reads standard output notices the end of the program.
    os.close(sys.stdout.fileno())
    os.read(sys.stdin.fileno(), 1)
    server.terminate()
    with contextlib.suppress(subprocess.TimeoutExpired):
        server.wait(PATIENCE_S)
    server.kill()
    server.wait()
    shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
