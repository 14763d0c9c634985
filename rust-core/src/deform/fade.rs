//! How far vertices follow what moves them beside the landmarks, and where that ends.
//!
//! Lids and lips keep to their landmarks, which know better when they touch.

use glam::Vec3;

/// How often shares are evened out between neighbours.
const EVENED: usize = 6;

/// 1 up to the first of two distances, 0 from the second on.
pub(crate) fn within(distance: f32, (full, gone): (f32, f32)) -> f32 {
    smooth((gone - distance) / (gone - full))
}

/// 0 nearer to some of the `points` than the first of two distances, 1 farther than the second.
pub(crate) fn beyond(points: &[[f32; 3]], p: [f32; 3], (near, far): (f32, f32)) -> f32 {
    let distances = points.iter().map(|q| Vec3::from(p).distance((*q).into()));
    let nearest = distances.fold(f32::INFINITY, f32::min);
    smooth((nearest - near) / (far - near))
}

/// Means over neighbours, some times, at the vertices `own`; no share grows, so that nothing follows from afar.
pub(crate) fn even_out(shares: &mut [f32], triangles: &[[u32; 3]], own: &[u32]) {
    for _ in 0..EVENED {
        let mut sums = vec![(0.0, 0.0); shares.len()];
        for triangle in triangles {
            let mean = triangle.iter().map(|&v| shares[v as usize]).sum::<f32>() / 3.0;
            for &v in triangle {
                sums[v as usize].0 += mean;
                sums[v as usize].1 += 1.0;
            }
        }
        for &v in own {
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
