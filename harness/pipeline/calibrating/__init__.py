"""How far landmarks are detected from a body model's own points, measured where bodies are known.

``landmark_offsets`` measures for Anny on generated people, ``smplx_calibration`` for SMPL-X on a
user's scans with fits.
"""
