"""All assemblies at one time, or the proof that there is none."""
