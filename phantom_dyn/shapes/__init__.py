"""Shape of a robot as triangles, for drawings and to bound where its mass can be."""
