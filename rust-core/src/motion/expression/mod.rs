//! Expressions of emotions, added to motion that speaks neutrally.
//!
//! A table holds the effect of each emotion on the face and on articulation. An expression added after
//! sampling has exactly the requested strength, whereas networks trained on squared error show two
//! thirds of it. Motion that lasts through speech (brows, lids, nose, corners) is simply added. Motion
//! that parts or stretches the lips yields where they close, and lips that speech closes stay closed.
//! Strengths follow the request with an onset and a slower offset, wander a little at the apex and grow
//! on stressed syllables.

mod apply;
mod causal;
mod dynamics;
mod lips;
mod manner;
mod table;
#[cfg(test)]
mod tests;

pub use causal::CausalExpression;
#[cfg(feature = "emoface")]
pub(crate) use dynamics::Follower;
pub use table::{Expressions, MODEL};

/// Where the emotion of sampled motion comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EmotionOrigin {
    /// The network was trained on emotional motion and shows the requested emotion.
    #[default]
    Learned,
    /// The network speaks neutrally; its motion needs an expression.
    Added,
}
