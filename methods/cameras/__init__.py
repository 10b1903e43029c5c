"""Cameras from the photos of a still person alone.

``values`` has what goes in and comes out, ``estimate`` the whole way: landmarks of single photos
(``landmarks``), outlines that must be coherent (``coherence``, ``search``), photos that are matched
on the hull (``matches``), and what is told of the result or refused (``checks``). All of them
solve with ``adjustment``.
"""
