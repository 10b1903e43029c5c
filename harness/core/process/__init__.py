"""Running code: child processes, interrupts, lazy registries, and what a result depends on."""
