"""What a training sample is varied by each time it is drawn.

``drawing`` puts it together. ``light`` says in which light photos are taken, ``relighting`` puts a
stored photo into another one;
``turning`` turns and enlarges, and ``photo_faults`` does what cameras, files and masks do.
"""
