"""A trial on real lesions: what the map of blur, or another program, finds of those that people drew in a BIDS folder.

    python -m isocortex.trial BIDS --like bonn
    python -m isocortex.trial.repeat BIDS

`isocortex bids` prepares the heads; this package judges its places. It needs `pip install 'isocortex[trial]'`.
"""

from .._extras import _imported

for _module in ("matplotlib", "nibabel", "scipy"):
    _imported(_module, "trial", "isocortex.trial")
