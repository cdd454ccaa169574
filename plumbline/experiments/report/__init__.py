"""What a diagnosis looks like: words on a terminal, pictures, and one HTML file."""
