"""Sound: strips of the sequencer and files, how they are decoded, and what is heard in them."""
