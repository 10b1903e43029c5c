"""The open normal network and its training.

Read ``network``, ``losses``, ``optimiser`` and ``loop``. ``samples`` draws what the network sees,
which ``variations`` vary; ``export`` writes the file that methods use,
``starting`` reads its weights again, and ``calibration`` compares its expected errors with the true
ones.
"""
