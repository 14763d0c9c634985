"""A head of clean quads whose shape is set by numbers: MakeHuman's topology on ICT's mean face."""
