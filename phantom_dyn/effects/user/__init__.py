"""Effects that a user defines: reads them from files, and checks them on a robot before they are used."""
