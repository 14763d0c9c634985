//! `cargo xtask site`: collects everything we publish in one folder, which any static file server
//! can serve.

pub mod documents;
mod frame;
mod front;
mod parts;

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Result, ensure};
use clap::Args;

use crate::{machine, steps::Steps};
use parts::Parts;

/// Marks a folder that we may empty. It also tells GitHub that the pages need no further
/// processing.
const MARK: &str = ".nojekyll";
const STYLE: &str = include_str!("../../site/style.css");

/// Writes target/site: a repository of Blender extensions, an index for pip, downloads, the page,
/// the documents.
#[derive(Args)]
pub struct Site {
    /// Folder of the packages that `cargo xtask package` made for any number of systems; default
    /// `target/package`.
    #[arg(long)]
    packages: Option<PathBuf>,
    /// Folder that `cargo xtask web` made; default `target/web`.
    #[arg(long)]
    web: Option<PathBuf>,
    /// Address of a page that has the downloads. The site then has no copies, since hosts limit its
    /// size.
    #[arg(long)]
    downloads: Option<String>,
    /// Folder for the site; default `target/site`. An earlier site there is deleted.
    #[arg(long)]
    out: Option<PathBuf>,
}

impl Site {
    /// Collects the parts, writes the site and prints what is missing.
    pub fn run(&self) -> Result<()> {
        let mut steps = Steps::new("site")?;
        let target = machine::target();
        let packages = self.packages.clone().unwrap_or(target.join("package"));
        let web = self.web.clone().unwrap_or(target.join("web"));
        ensure!(
            self.web.is_none() || web.join("index.html").is_file(),
            "no page at {}: run `cargo xtask web`, or leave --web out",
            web.display()
        );
        let out = self.out.clone().unwrap_or(target.join("site"));
        let mut parts = Parts::find(&packages, &web)?;
        parts.downloads_page.clone_from(&self.downloads);
        empty(&out)?;
        parts.write(&mut steps, &out)?;
        let documents = documents::write(&machine::root(), &out.join("docs"))?;
        println!("wrote    {documents} documents, all links checked");
        fs::write(out.join("style.css"), STYLE)?;
        fs::write(out.join("index.html"), front::page(&parts))?;
        for missing in parts.missing() {
            println!("missing  {missing}");
        }
        println!("serve    {}", out.display());
        steps.finish()
    }
}

/// Creates the folder, or empties it if an earlier site wrote it. Any other folder with files is an
/// error.
fn empty(out: &Path) -> Result<()> {
    let is_free = fs::read_dir(out).map_or(true, |mut entries| entries.next().is_none());
    ensure!(
        is_free || out.join(MARK).is_file(),
        "{}: expected an empty folder or an earlier site, got a folder with other files: name another one by --out",
        out.display()
    );
    machine::empty(out)?;
    fs::write(out.join(MARK), "")?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_of_others_is_not_emptied() {
        let folder = std::env::temp_dir().join(format!("anyface-site-{}", std::process::id()));
        empty(&folder).unwrap();
        fs::write(folder.join("old.html"), "").unwrap();
        empty(&folder).unwrap();
        assert!(!folder.join("old.html").exists());
        fs::remove_file(folder.join(MARK)).unwrap();
        fs::write(folder.join("thesis.txt"), "").unwrap();
        let words = empty(&folder).unwrap_err().to_string();
        assert!(words.contains("--out"), "{words}");
        assert!(folder.join("thesis.txt").exists());
        fs::remove_dir_all(folder).unwrap();
    }
}
