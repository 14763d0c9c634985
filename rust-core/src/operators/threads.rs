//! The number of threads for large products and factorisations.

use faer::Par;

/// All threads of the pool, or one in builds without a pool, as in a browser.
pub(super) fn threads() -> Par {
    #[cfg(feature = "parallel")]
    return Par::rayon(0);
    #[cfg(not(feature = "parallel"))]
    return Par::Seq;
}
