"""Sound: strips of the sequencer and files, decoded, and what is heard in them."""
