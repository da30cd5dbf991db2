"""What a hand feels of a cheaper device."""
