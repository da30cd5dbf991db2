"""Shape of a robot as triangles, for drawings and for where its mass can be."""
