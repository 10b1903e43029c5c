"""What is measured: the manifest, the scans, the generated avatars."""
