"""Code that runs in an interpreter of its own: other packages, other versions, one file.

A worker is one Python file that needs nothing of ours. ``method.toml`` beside it says how it is
called and what has to be importable (``manifest``); the user says which interpreter has that
(``interpreter``). Arrays go there and back in ``.npz`` files, and nothing is unpickled
(``exchange``). ``start`` is the first file that runs there: it ends with the process that asked.
"""
