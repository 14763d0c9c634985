"""Sound: sequencer strips, sound files, decoding, recording, and text strips for speech sounds."""
