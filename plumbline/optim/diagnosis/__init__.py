"""Where the gap lies, which effect causes it, and how far it shrinks."""
