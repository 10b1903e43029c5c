"""The open normal network and its training.

Read ``networks``, ``losses``, ``optimiser`` and ``loop``. ``samples`` holds what the network sees,
``batch_sampler`` draws it as ``variations`` vary it, and ``first_answers`` puts one network's
answers in place of the body for the next. ``calibration`` compares a network's expected errors with
the true ones.
"""
