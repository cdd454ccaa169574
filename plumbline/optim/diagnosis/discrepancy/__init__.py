"""What a closed list lacks: unknown smooth dependences."""
