//! How many threads large products and factorisations take.

use faer::Par;

/// All of the pool; one where the build has none, as in a browser.
pub(super) fn threads() -> Par {
    #[cfg(feature = "parallel")]
    return Par::rayon(0);
    #[cfg(not(feature = "parallel"))]
    return Par::Seq;
}
