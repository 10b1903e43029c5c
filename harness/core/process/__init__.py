"""Running code: child processes, interrupts, names resolved late, and what a result depends on."""
