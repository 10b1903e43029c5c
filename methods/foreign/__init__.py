"""Code that runs in an interpreter of its own: other packages, other versions.

There are two forms. A worker answers a method that runs here: one Python file that needs nothing of
ours, a ``method.toml`` beside it that says how it is called and what has to be importable
(``manifest``), and arrays that go there and back in ``.npz`` files (``exchange``); ``start`` is the
first file that runs there. A whole method is a command (``command_method``): its ``method.toml``
(``method_file``) says how it is started (``launch``), it is given photos in a folder
(``photo_folder``), and writes one mesh file. What it runs in is part of it (``environment``).

For both, the user says which interpreter it is (``interpreter``), nothing is unpickled, and nothing
stays when the process that asked is gone (``guard``, ``running``).
"""
