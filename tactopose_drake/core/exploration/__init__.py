"""Which touch to make next: guarded moves, and what each would tell."""
