"""What several rooms need of the machine: threads, locks, checkpoints, images, stopping, shared steps."""
