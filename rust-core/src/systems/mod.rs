//! One folder per paper; systems never import each other.

pub mod freetalk;
