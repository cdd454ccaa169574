"""What the commands share: outputs, progress, streams, worker processes."""
