"""The inner loops, compiled for the CPU by Warp: correlation of patches under a plane.

Numpy would take minutes: eight photos need about three thousand million bilinear samples, each at a
place that depends on the one before. Warp comes with the body model; its kernels compile in a few
seconds on the first run and are kept in the user's cache folder (``WARP_CACHE_PATH`` moves it).

Warp reads its own language from the functions here, so they are plainer than Python elsewhere.
"""

from methods.stereo.kernels.device import device_array, launch
