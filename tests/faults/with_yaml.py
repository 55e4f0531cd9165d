"""Runs a program again by the Python that has a reader of YAML (scripts/kubernetes.sh), where this one has none."""

import os
import sys

from attack import skip

BESIDE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "demo-data", "kubernetes", "bin", "python")


def need(*modules):
    try:
        for module in modules:
            __import__(module)
    except ImportError:
        if os.path.exists(BESIDE) and os.path.abspath(sys.prefix) != os.path.dirname(os.path.dirname(os.path.abspath(BESIDE))):
            os.execv(BESIDE, [BESIDE, *sys.argv])
        skip(f"Python has no {' or '.join(modules)}: run scripts/kubernetes.sh")
