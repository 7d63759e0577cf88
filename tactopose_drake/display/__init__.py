"""Pictures of an estimate: what a scene holds, from where it is seen, and how it is drawn without a display."""
