"""A model as files for others: URDF, MJCF, DH rows, a table, C; each says what it cannot hold."""
