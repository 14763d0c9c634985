//! Options that several subcommands share.

use std::path::{Path, PathBuf};

use anyface::{CachePolicy, Engine, EngineOptions, Error, Result};
use clap::Args;

/// Options of every subcommand.
#[derive(Args)]
pub(super) struct SharedArgs {
    /// System that turns speech into motion [default: the first that `anyface info` lists]
    #[arg(long, global = true, value_name = "NAME")]
    system: Option<String>,
    /// Folder of model files that override the embedded ones
    #[arg(long, global = true, value_name = "DIR")]
    pub weights: Option<PathBuf>,
    /// Folder with a HuBERT or wav2vec2 config.json and model.safetensors, instead of the
    /// embedded speech encoder
    #[arg(long, global = true, value_name = "DIR")]
    speech: Option<PathBuf>,
    /// Do not cache the work for each mesh between runs
    #[arg(long, global = true)]
    no_cache: bool,
    /// Worker threads [default: one per core]
    #[arg(long, global = true, value_name = "N")]
    threads: Option<usize>,
    /// Print results as JSON
    #[arg(long, global = true)]
    pub json: bool,
}

impl SharedArgs {
    /// Sizes the thread pool that all parallel work shares.
    pub(super) fn set_threads(&self) -> Result<()> {
        let Some(threads) = self.threads else {
            return Ok(());
        };
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build_global()
            .map_err(|e| Error::InvalidInput(format!("threads: {e}")))
    }

    /// An engine with these options.
    pub(super) fn engine(&self) -> Result<Engine> {
        self.engine_of(self.system.as_deref())
    }

    /// An engine with these options but another system.
    pub(super) fn engine_of(&self, system: Option<&str>) -> Result<Engine> {
        Engine::new(EngineOptions {
            system: system.map(str::to_owned),
            models: self.weights.clone(),
            speech: self.speech.clone(),
            cache: if self.no_cache {
                CachePolicy::Off
            } else {
                CachePolicy::UserFolder
            },
            threads: self.threads,
        })
    }
}

/// The folder of recordings, faces and meshes, which are not part of this repository.
#[derive(Args)]
pub(super) struct DataArgs {
    /// Data folder: motion/, faces/ and meshes/ [default: data in the folder ANYFACE_SHARED]
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
}

impl DataArgs {
    /// The folder given on the command line, or else the one among the shared files.
    pub(super) fn folder(&self) -> Result<PathBuf> {
        match (&self.data, std::env::var_os("ANYFACE_SHARED")) {
            (Some(folder), _) => Ok(folder.clone()),
            (None, Some(shared)) => Ok(Path::new(&shared).join("data")),
            (None, None) => Err(Error::InvalidInput(
                "data: expected --data DIR or the variable ANYFACE_SHARED, got neither".into(),
            )),
        }
    }
}
