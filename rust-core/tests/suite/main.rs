//! Tests of the whole library and its command, in one binary so that it is linked once.

mod cafe_talk;
mod command;
mod corpus;
mod damaged;
mod emoface;
mod expressions;
mod facetalk;
mod features;
mod head;
mod hostile;
mod imports;
mod kept_faces;
mod landmarks;
mod lids;
mod life;
mod parts;
mod performance;
mod runs;
mod sliders;
mod spread;
mod weights;
