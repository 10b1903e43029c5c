"""Where work is carried out: in threads of this process, on a Ray cluster, as Slurm array jobs.

An executor knows tasks: a handler's name, JSON values, and which task has to come first. It knows
neither photos nor methods, so that whatever is made of tasks runs on all of them.
"""
