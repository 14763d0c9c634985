//! `cargo xtask site`: all that is handed out as one folder, which any host of files can serve.

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

/// Says that a folder may be emptied, and to GitHub that its pages are ready.
const MARK: &str = ".nojekyll";
const STYLE: &str = include_str!("../../site/style.css");

/// Writes target/site: a repository of Blender extensions, an index for pip, downloads, the page, the documents.
#[derive(Args)]
pub struct Site {
    /// Folder of what `cargo xtask package` made, of any number of systems; default `target/package`.
    #[arg(long)]
    packages: Option<PathBuf>,
    /// Folder that `cargo xtask web` made; default `target/web`.
    #[arg(long)]
    web: Option<PathBuf>,
    /// Address of a page that has the downloads, which are not copied then: hosts limit the size of a site.
    #[arg(long)]
    downloads: Option<String>,
    /// Where the site goes; default `target/site`. What an earlier site left there goes.
    #[arg(long)]
    out: Option<PathBuf>,
}

impl Site {
    /// Collects, writes, says what is missing.
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

/// Makes the folder, or empties that of an earlier site; leaves folders of others alone.
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
