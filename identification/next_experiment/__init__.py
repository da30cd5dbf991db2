"""Which recording to make next, so that causes that one recording cannot part are parted by two."""
