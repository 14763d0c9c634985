//! Shares by which vertices follow something other than the landmarks, and how these shares fade
//! out.
//!
//! Lids and lips follow their landmarks alone, because the landmarks show best when lids and lips
//! touch.

use glam::Vec3;

/// How many times shares are averaged over neighbours.
const EVENED: usize = 6;

/// 1 up to the distance `full`, 0 from the distance `gone` on, smooth in between.
pub(crate) fn within(distance: f32, (full, gone): (f32, f32)) -> f32 {
    smooth((gone - distance) / (gone - full))
}

/// 0 where `p` lies nearer than `near` to any of the `points`, 1 where it lies farther than `far`
/// from all of them. In between, the value rises smoothly.
pub(crate) fn beyond(points: &[[f32; 3]], p: [f32; 3], (near, far): (f32, f32)) -> f32 {
    let distances = points.iter().map(|q| Vec3::from(p).distance((*q).into()));
    let nearest = distances.fold(f32::INFINITY, f32::min);
    smooth((nearest - near) / (far - near))
}

/// Smooths the shares of `vertices` by averaging them over their neighbours, several times. A share
/// never grows, so no vertex begins to follow something far away.
pub(crate) fn even_out(shares: &mut [f32], triangles: &[[u32; 3]], vertices: &[u32]) {
    for _ in 0..EVENED {
        let mut sums = vec![(0.0, 0.0); shares.len()];
        for triangle in triangles {
            let mean = triangle.iter().map(|&v| shares[v as usize]).sum::<f32>() / 3.0;
            for &v in triangle {
                sums[v as usize].0 += mean;
                sums[v as usize].1 += 1.0;
            }
        }
        for &v in vertices {
            let (sum, count) = sums[v as usize];
            if count > 0.0 {
                shares[v as usize] = shares[v as usize].min(sum / count);
            }
        }
    }
}

fn smooth(x: f32) -> f32 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}
