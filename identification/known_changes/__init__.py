"""What is known to be different between several recordings of one robot, and what may have changed between them."""
