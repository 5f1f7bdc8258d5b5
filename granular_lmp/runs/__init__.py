"""One deck in one run folder: launch, manifest, record, snapshots."""
