"""What several rooms need of the machine: threads, locks, checkpoints, images, stopping, a team of processes."""
