//! Finds the 68 landmarks of a face on a mesh, however it is turned, in any units and any place.
//!
//! 1. *Search*: depth pictures of the mesh are drawn from the stated front first, then from 14
//!    sides. A small network finds faces in them and says how they are turned, then looks again
//!    from the estimated front. If the mesh mirrors itself in a plane, the search also tries faces
//!    with this plane in their middle. The landmark network ranks the candidates, because it
//!    distinguishes faces from backs of heads.
//! 2. *Lift*: the landmarks of a close front view are put on the visible surface. This gives the
//!    head's pose and size.
//! 3. *Consensus*: three views at −40°, 0° and 40° in the head's own frame see the landmarks, even
//!    those that face away. The rays of the three views meet in space (after Paulsen et al. 2018,
//!    "Multi-view Consensus CNN for 3D Facial Landmark Placement", with three fixed views and depth
//!    in place of many views and colour). This runs three times, each in a better frame. Where no
//!    face is certain (blocks, noise or folds on the surface), steps 2 and 3 run again with
//!    softened pictures. The plane in which the mesh around an uncertain face mirrors itself must
//!    lie between its eyes. Otherwise the search turns the face so that it does (`upright`).
//! 4. *Shape*: a Gaussian over landmark shapes corrects impossible ones. Fixed landmarks are exact,
//!    and the others follow them.
//! 5. *Snap*: each landmark moves to the nearest skin, inner-lip landmarks to their own lip.

mod consensus;
mod depth_view;
mod network;
mod pose_network;
mod prior;
mod search;
mod symmetry;
mod upright;
mod view;

use std::{path::Path, sync::OnceLock};

use serde::Deserialize;

use self::{
    consensus::{Agreed, GLANCE, LAST_LOOK, agree, lift},
    network::LandmarkNetwork,
    pose_network::PoseNetwork,
    prior::{Measured, ShapePrior},
    search::{Candidate, Looks, Search},
    upright::{poses_across, turned_away},
    view::{Frame, stated_frame},
};
use super::{
    Axis, FixedLandmark, Landmarks, Mesh, Similarity,
    canonical::{self, canonical_landmarks},
    ibug::{LANDMARKS, REGIONS},
    snap::snap_to_surface,
};
use crate::{
    Error, Result,
    job::ProgressFn,
    models::{BuiltIn, Weights},
};

/// The built-in weights of the landmark finder.
pub static MODEL: BuiltIn = BuiltIn::new(&anyface_weights_shared::LANDMARKS);

/// Least mean confidence of the mouth's landmarks. Below it, there is no mouth.
const LEAST_MOUTH: f32 = 0.4;

/// Least probability of a face, averaged over the last views. Below it, there is no face around the
/// mouth. Chosen with sixteen characters (0.93 and more, one 0.72) and 32 things, among which cups
/// with a handle reached 0.87.
const LEAST_PRESENCE: f32 = 0.92;

/// Least mean confidence of all landmarks. Below it, something that looks like a mouth has no face
/// around it: boxes and the handle of a cup reached 0.31, a monkey's head 0.54.
const LEAST_CONFIDENCE: f32 = 0.35;

/// Least confidence of the eyes or the brows, whichever is larger. Below it, a possible mouth has
/// no face around it. The muzzle of a koala on all fours reached 0.12. The brows of heads whose
/// eyes lie under cubes reached 0.25.
const LEAST_EYES_OR_BROWS: f32 = 0.2;

/// A mesh with fewer triangles is not searched: brows, eyes, nose and mouth take more.
const LEAST_TRIANGLES: usize = 40;

/// Least likeness of a face, seen from its front.
const LEAST_LIKENESS: f32 = 0.3;

/// A face above this rank (`Settled::rank`) ends the search: no other candidate is tried, and no
/// softened picture is drawn.
const SURE: (bool, f32) = (true, 0.7);

/// Deviation of the Gaussian that softens pictures, pixels of the depth buffer (0.8 mm on a human
/// face). Blocks, folds and noise of a few millimetres vanish. Lips and lids stay.
const SOFTNESS: f32 = 2.5;

/// A face in softened pictures must exceed this rank (`Settled::rank`). It needs more confidence
/// than a face in sharp pictures.
const LEAST_SOFTLY: (bool, f32) = (true, 0.5);

/// A face in softened pictures replaces the one in sharp pictures only if its mean confidence is
/// higher by more than this, because small features are less exact in softened pictures.
const CLEARER: f32 = 0.1;

/// Where enough landmarks are fixed, a front view with a lower probability of a face does not
/// change the pose.
const LEAST_PRESENCE_BESIDE_FIXED: f32 = 0.5;

/// This many fixed landmarks determine the face's pose without a search.
const ENOUGH_FIXED: usize = 4;

/// Confidence of known landmarks in `follow`, where the caller fixes some of them elsewhere.
const CALLER_CONFIDENCE: f32 = 0.5;

/// The `config.json` beside the weights.
#[derive(Debug, Clone, Deserialize)]
struct Config {
    /// Channels of the landmark network at 64², 32², 16² and 8².
    widths: [usize; 4],
    /// Channels of the pose network at 64², 32², 16², 8² and 4².
    pose_widths: [usize; 5],
    /// Modes of the shape prior.
    prior_modes: usize,
}

impl Config {
    /// # Errors
    /// `Weights` if the text is not a config.
    fn parse(json: &str) -> Result<Self> {
        serde_json::from_str(json)
            .map_err(|error| Error::Weights(format!("landmarks/config.json: {error}")))
    }
}

/// Finds landmarks. Holds the networks' weights. Any number of threads may share it.
pub struct LandmarkFinder {
    views: LandmarkNetwork,
    pose: PoseNetwork,
    prior: ShapePrior,
}

/// A candidate whose views agree.
#[derive(Clone)]
struct Settled {
    /// From the frame to canonical metres. `agreed` is in canonical metres.
    to_canonical: Similarity,
    agreed: Agreed,
}

impl Settled {
    /// Mean confidence of all landmarks.
    fn confidence(&self) -> f32 {
        self.agreed.confidence.iter().sum::<f32>() / LANDMARKS as f32
    }

    /// Mean confidence of each of `REGIONS`.
    fn regions(&self) -> [(&'static str, f32); REGIONS.len()] {
        REGIONS.map(|(name, range)| {
            let count = range.len() as f32;
            (
                name,
                self.agreed.confidence[range].iter().sum::<f32>() / count,
            )
        })
    }

    /// The larger, the better: a possible face exceeds all others, then confidence decides.
    fn rank(&self) -> (bool, f32) {
        (self.doubt().is_none(), self.confidence())
    }

    /// Whether this face from softened pictures replaces the one from sharp pictures.
    fn clearer_than(&self, sharp: Option<&Settled>) -> bool {
        sharp.is_none_or(|sharp| {
            let (face, confidence) = sharp.rank();
            self.rank() > (face, confidence + CLEARER)
        })
    }

    /// Why this is no face: it has no mouth, nothing around the mouth looks like a face, or it has
    /// neither eyes nor brows. `None` if it is a face.
    fn doubt(&self) -> Option<String> {
        let [(_, mouth), others @ ..] = self.regions();
        let (presence, all) = (self.agreed.presence, self.confidence());
        let eyes_or_brows = others
            .iter()
            .filter(|(name, _)| matches!(*name, "eyes" | "brows"));
        let eyes_or_brows = eyes_or_brows.map(|(_, sure)| *sure).fold(0.0, f32::max);
        let what = if mouth < LEAST_MOUTH {
            format!("no mouth (confidence {mouth:.2}, expected {LEAST_MOUTH} or more")
        } else if presence < LEAST_PRESENCE || all < LEAST_CONFIDENCE {
            format!(
                "no face about what may be a mouth (likeness {presence:.2}, expected {LEAST_PRESENCE} or \
                 more; confidence {all:.2}, expected {LEAST_CONFIDENCE} or more"
            )
        } else if eyes_or_brows < LEAST_EYES_OR_BROWS {
            format!(
                "neither eyes nor brows above what may be a mouth (confidence expected: {LEAST_EYES_OR_BROWS} or more"
            )
        } else {
            return None;
        };
        let others = others.map(|(name, sure)| format!("{name} {sure:.2}"));
        Some(format!("the best place has {what}; {})", others.join(", ")))
    }
}

impl LandmarkFinder {
    /// The finder with the embedded weights, loaded once.
    ///
    /// # Errors
    /// `Weights` if the embedded files are damaged.
    pub fn embedded() -> Result<&'static LandmarkFinder> {
        static FINDER: OnceLock<LandmarkFinder> = OnceLock::new();
        if let Some(finder) = FINDER.get() {
            return Ok(finder);
        }
        let finder = Self::load(None)?;
        Ok(FINDER.get_or_init(|| finder))
    }

    /// A finder with the model in `folder/landmarks` if that exists, else the built-in one.
    ///
    /// # Errors
    /// `Io` if one of the model's two files is missing, `Weights` if one is damaged or does not
    /// fit the other, or `folder` does not exist.
    pub fn load(folder: Option<&Path>) -> Result<LandmarkFinder> {
        let files = MODEL.open(folder)?;
        let weights = Weights::from_bytes(&files.weights)?;
        let config = Config::parse(&files.config)?;
        Ok(LandmarkFinder {
            views: LandmarkNetwork::load(&weights.pp("views"), config.widths)?,
            pose: PoseNetwork::load(&weights.pp("pose"), config.pose_widths)?,
            prior: ShapePrior::load(&weights.pp("prior"), config.prior_modes)?,
        })
    }

    /// Finds the landmarks of the face on a mesh, however it is turned. Where several places look
    /// alike, the face along `forward` with its top towards `up` wins. The mesh may also have a
    /// neck, shoulders, a body, hair, eyes and teeth. Every landmark in `fixed` stays where the
    /// caller puts it, and the others follow. Four or more fixed landmarks determine where the face
    /// is.
    ///
    /// # Errors
    /// `FaceNotFound`, which says what the networks saw and what would help; `InvalidInput` if the
    /// axes are on one line or a fixed landmark is impossible; `Mesh` for an unusable mesh;
    /// `Cancelled`.
    pub fn find(
        &self,
        mesh: &Mesh,
        forward: Axis,
        up: Axis,
        fixed: &[FixedLandmark],
        progress: ProgressFn<'_>,
    ) -> Result<Landmarks> {
        mesh.check()?;
        let frame = stated_frame(mesh, forward, up)?;
        let looks = Looks::new(progress, &frame);
        let places = places_of(mesh, fixed)?;
        let in_frame = moved(&places, &frame.from_mesh);
        let settled = match self.pose_of_fixed(&frame, &in_frame, &looks)? {
            Some(settled) => settled,
            None if mesh.triangles.len() < LEAST_TRIANGLES => {
                return Err(Error::FaceNotFound(advice(&format!(
                    "the mesh has {} triangles (expected {LEAST_TRIANGLES} or more)",
                    mesh.triangles.len()
                ))));
            }
            None => self.best(&frame, &in_frame, &looks)?,
        };
        looks.check()?;
        let to_canonical = settled.to_canonical.compose(&frame.from_mesh);
        self.shaped(mesh, &to_canonical, &settled.agreed, &places)
    }

    /// Moves some of the caller's landmarks to their `fixed` places. The others follow.
    ///
    /// # Errors
    /// `InvalidInput` if a fixed landmark is impossible, `FaceNotFound` if the result is no face.
    pub fn follow(
        &self,
        mesh: &Mesh,
        known: &Landmarks,
        fixed: &[FixedLandmark],
    ) -> Result<Landmarks> {
        let places = places_of(mesh, fixed)?;
        let to_canonical = canonical::fit_to_canonical(&known.positions, None)?.similarity;
        let agreed = Agreed {
            positions: known.positions.map(|p| to_canonical.apply(p)),
            confidence: [CALLER_CONFIDENCE; LANDMARKS],
            presence: 1.0,
        };
        let mut landmarks = self.shaped(mesh, &to_canonical, &agreed, &places)?;
        for (now, before) in landmarks.confidence.iter_mut().zip(known.confidence) {
            *now = now.max(before);
        }
        Ok(landmarks)
    }

    /// Finds the clearest face in sharp pictures or, if that face is uncertain, in softened ones.
    /// The error says what the networks saw and what would help.
    fn best(
        &self,
        frame: &Frame,
        fixed: &[(usize, [f32; 3])],
        looks: &Looks<'_>,
    ) -> Result<Settled> {
        let search = Search {
            pose: &self.pose,
            views: &self.views,
            frame,
            looks,
        };
        let all = search.run()?;
        let likely = all.iter().filter(|c| c.likeness >= LEAST_LIKENESS);
        let sharp = self.surest(frame, likely, fixed, looks)?;
        if let Some(settled) = sharp.as_ref().filter(|s| s.rank() > SURE) {
            return Ok(settled.clone());
        }
        let soft = self.surest(&frame.soft(SOFTNESS), all.iter(), fixed, looks)?;
        let clearer = |s: &Settled| s.rank() > LEAST_SOFTLY && s.clearer_than(sharp.as_ref());
        let Some(settled) = soft.filter(clearer).or(sharp) else {
            let likeness = all.first().map_or(0.0, |c| c.likeness);
            return Err(Error::FaceNotFound(advice(&format!(
                "no side of the mesh looks like a face (likeness {likeness:.2} at best, expected \
                 {LEAST_LIKENESS} or more)"
            ))));
        };
        match settled.doubt() {
            None => self.upright(frame, settled, fixed, looks),
            Some(doubt) => Err(Error::FaceNotFound(advice(&doubt))),
        }
    }

    /// Returns `face` if the plane in which the mesh around it mirrors itself lies between its
    /// eyes. Otherwise turns the face so that it does. A certain face passes unchecked.
    ///
    /// # Errors
    /// `FaceNotFound` if the turned face is not convincing; `Cancelled`.
    fn upright(
        &self,
        frame: &Frame,
        face: Settled,
        fixed: &[(usize, [f32; 3])],
        looks: &Looks<'_>,
    ) -> Result<Settled> {
        if face.rank() > SURE {
            return Ok(face);
        }
        let Some(plane) = turned_away(frame, &face.to_canonical) else {
            return Ok(face);
        };
        let mut best: Option<Settled> = None;
        for pose in poses_across(&plane, &face.to_canonical) {
            let settled = self.settle(frame, &pose, fixed, looks)?;
            let upright = settled
                .filter(|s| s.doubt().is_none() && turned_away(frame, &s.to_canonical).is_none());
            let better = |s: &Settled| best.as_ref().is_none_or(|b| s.rank() > b.rank());
            best = upright.filter(better).or(best);
        }
        best.ok_or_else(|| {
            let degrees = plane.normal.x.abs().acos().to_degrees();
            Error::FaceNotFound(advice(&format!(
                "the best place has a face that lies at {degrees:.0}° to the plane in which the mesh about it mirrors \
                 itself (expected: left and right of a face mirror each other), so that its mouth may be an eye"
            )))
        })
    }

    /// The most convincing candidate. Stops at the first certain one.
    fn surest<'a>(
        &self,
        frame: &Frame,
        candidates: impl Iterator<Item = &'a Candidate>,
        fixed: &[(usize, [f32; 3])],
        looks: &Looks<'_>,
    ) -> Result<Option<Settled>> {
        let mut best: Option<Settled> = None;
        for candidate in candidates {
            let settled = self.settle(frame, &candidate.to_canonical, fixed, looks)?;
            let better = |s: &Settled| best.as_ref().is_none_or(|b| s.rank() > b.rank());
            best = settled.filter(better).or(best);
            if best.as_ref().is_some_and(|b| b.rank() > SURE) {
                break;
            }
        }
        Ok(best)
    }

    /// Lift and consensus, steps 2 and 3 of the module.
    fn settle(
        &self,
        frame: &Frame,
        to_canonical: &Similarity,
        fixed: &[(usize, [f32; 3])],
        looks: &Looks<'_>,
    ) -> Result<Option<Settled>> {
        let is_placed = fixed.len() >= ENOUGH_FIXED;
        let least_presence = if is_placed {
            LEAST_PRESENCE_BESIDE_FIXED
        } else {
            0.0
        };
        let lifted = lift(&self.views, frame, to_canonical, least_presence);
        let mut to_canonical = lifted.unwrap_or(*to_canonical);
        let look = |to_canonical: &Similarity, half_sizes: &[f32]| {
            let mut agreed = agree(&self.views, frame, to_canonical, half_sizes);
            if is_placed {
                agreed.trust_by_presence();
            }
            agreed
        };
        let mut agreed = look(&to_canonical, &GLANCE);
        for half_sizes in [&GLANCE[..], &LAST_LOOK] {
            looks.check()?;
            agreed.pin(&moved(fixed, &to_canonical));
            let Some(better) = agreed.fit(&to_canonical) else {
                return Ok(None);
            };
            to_canonical = better;
            agreed = look(&to_canonical, half_sizes);
        }
        Ok(Some(Settled {
            to_canonical,
            agreed,
        }))
    }

    /// The pose that enough fixed landmarks determine, even if the views see little there.
    fn pose_of_fixed(
        &self,
        frame: &Frame,
        fixed: &[(usize, [f32; 3])],
        looks: &Looks<'_>,
    ) -> Result<Option<Settled>> {
        if fixed.len() < ENOUGH_FIXED {
            return Ok(None);
        }
        let from: Vec<[f32; 3]> = fixed.iter().map(|(_, p)| *p).collect();
        let to: Vec<[f32; 3]> = fixed
            .iter()
            .map(|(i, _)| canonical_landmarks()[*i])
            .collect();
        match Similarity::fit(&from, &to, None) {
            Ok(fit) => self.settle(frame, &fit.similarity, fixed, looks),
            Err(_) => Ok(None),
        }
    }

    /// Shape and snap, steps 4 and 5 of the module.
    fn shaped(
        &self,
        mesh: &Mesh,
        to_canonical: &Similarity,
        agreed: &Agreed,
        fixed: &[(usize, [f32; 3])],
    ) -> Result<Landmarks> {
        let mut measured: [Measured; LANDMARKS] = std::array::from_fn(|i| Measured {
            position: agreed.positions[i],
            confidence: agreed.confidence[i],
            fixed: false,
        });
        for (i, position) in moved(fixed, to_canonical) {
            measured[i] = Measured {
                position,
                confidence: 1.0,
                fixed: true,
            };
        }
        let (positions, confidence) = self.prior.refine(&measured)?;
        let to_mesh = to_canonical.inverse();
        let mut landmarks = snap_to_surface(mesh, &positions.map(|p| to_mesh.apply(p)))?;
        landmarks.confidence = confidence;
        let fit = canonical::fit_to_canonical(&landmarks.positions, Some(&landmarks.confidence))?;
        canonical::check(&fit, &landmarks.confidence)
            .map_err(|error| Error::FaceNotFound(advice(&error.to_string())))?;
        Ok(landmarks)
    }
}

fn advice(finding: &str) -> String {
    format!(
        "{finding}. Give a mesh with a head of its own whose eyes, nose and mouth are modelled, say where \
         five points of it are (outer corners of the eyes, landmarks 36 and 45; tip of the nose, 30; \
         corners of the mouth, 48 and 54), or give all 68"
    )
}

/// The places of the landmarks that the caller fixed, mesh units.
///
/// # Errors
/// `InvalidInput` for an impossible index, vertex or position, or an index that appears twice.
fn places_of(mesh: &Mesh, fixed: &[FixedLandmark]) -> Result<Vec<(usize, [f32; 3])>> {
    let mut is_fixed = [false; LANDMARKS];
    fixed
        .iter()
        .map(|landmark| {
            let place = landmark.position_on(mesh)?;
            if std::mem::replace(&mut is_fixed[landmark.index], true) {
                Err(Error::InvalidInput(format!(
                    "fixed landmarks: index {} appears twice",
                    landmark.index
                )))
            } else {
                Ok((landmark.index, place))
            }
        })
        .collect()
}

fn moved(places: &[(usize, [f32; 3])], by: &Similarity) -> Vec<(usize, [f32; 3])> {
    places.iter().map(|(i, p)| (*i, by.apply(*p))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settled(mouth: f32, others: f32, presence: f32) -> Settled {
        let mut confidence = [others; LANDMARKS];
        confidence[48..].fill(mouth);
        Settled {
            to_canonical: Similarity::IDENTITY,
            agreed: Agreed {
                positions: *canonical_landmarks(),
                confidence,
                presence,
            },
        }
    }

    /// No face is found on the mesh, and the reason says so.
    fn assert_refused(mesh: &Mesh, reason: &str) {
        let finder = LandmarkFinder::embedded().unwrap();
        let error = finder
            .find(mesh, Axis::PosZ, Axis::PosY, &[], crate::job::SILENT)
            .unwrap_err();
        assert!(
            matches!(&error, Error::FaceNotFound(m) if m.contains(reason)),
            "{error}"
        );
    }

    /// Stars with crossing edges: each of a thousand triangles covers most of the star.
    #[test]
    fn triangles_over_each_other_end_the_search() {
        let corners = 1_023;
        let mut mesh = Mesh::default();
        for star in 0..8 {
            let first = mesh.positions.len() as u32;
            let angle =
                |i: usize| (i * 511 % corners) as f32 / corners as f32 * std::f32::consts::TAU;
            let corner = |i: usize| [angle(i).cos(), angle(i).sin(), 0.1 * star as f32];
            mesh.positions.extend((0..corners).map(corner));
            let triangle = |i: u32| [first, first + i, first + i + 1];
            mesh.triangles.extend((1..corners as u32 - 1).map(triangle));
        }
        assert_refused(&mesh, "over each other");
    }

    #[test]
    fn a_mesh_of_a_few_triangles_is_not_searched() {
        let mesh = Mesh {
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        };
        assert_refused(&mesh, "4 triangles (expected 40 or more)");
    }

    #[test]
    fn what_is_seen_softly_must_be_clearer() {
        let all = |confidence: f32, presence: f32| settled(confidence, confidence, presence);
        let sharp = all(0.6, 0.99);
        assert!(!all(0.65, 0.99).clearer_than(Some(&sharp)));
        assert!(all(0.75, 0.99).clearer_than(Some(&sharp)));
        let no_face = all(0.9, 0.2);
        assert!(all(0.55, 0.99).clearer_than(Some(&no_face)) && all(0.55, 0.99).clearer_than(None));
    }

    #[test]
    fn a_mouth_in_a_face_is_enough_whatever_the_rest() {
        assert_eq!(settled(0.9, 0.2, 0.99).doubt(), None);
        assert!(
            settled(0.9, 0.05, 0.99)
                .doubt()
                .unwrap()
                .contains("no face")
        );
        let doubt = settled(0.3, 0.9, 0.99).doubt().unwrap();
        assert!(
            doubt.contains("no mouth (confidence 0.30") && doubt.contains("jaw 0.90"),
            "{doubt}"
        );
        let doubt = settled(0.9, 0.9, 0.5).doubt().unwrap();
        assert!(
            doubt.contains("no face") && doubt.contains("likeness 0.50"),
            "{doubt}"
        );
    }

    #[test]
    fn a_truncated_model_in_a_folder_is_a_weights_error() {
        let folder = tempfile::tempdir().unwrap();
        let model = folder.path().join(MODEL.name);
        std::fs::create_dir(&model).unwrap();
        let files = MODEL.open(None).unwrap();
        std::fs::write(model.join("config.json"), files.config.as_bytes()).unwrap();
        let missing = LandmarkFinder::load(Some(folder.path()));
        assert!(matches!(missing, Err(Error::Io { .. })));
        let half = &files.weights[..files.weights.len() / 2];
        std::fs::write(model.join("model.safetensors"), half).unwrap();
        let truncated = LandmarkFinder::load(Some(folder.path()));
        assert!(matches!(truncated, Err(Error::Weights(_))));
    }
}
