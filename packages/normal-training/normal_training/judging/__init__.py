"""How good networks of normals are on generated people: angles, folds, and what prints do.

Read ``judge`` for a measurement from subjects to means. ``photos`` measures one photo, in the child
process that ``judge_worker`` runs for each subject.
"""
