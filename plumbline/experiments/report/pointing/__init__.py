"""Pictures of pointing."""
