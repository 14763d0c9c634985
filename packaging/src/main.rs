//! Everything a developer or a release does with the repository: `cargo xtask --help`.

mod addon;
mod apt;
mod chroot;
mod cross;
mod debian;
mod demo;
mod docs;
mod elsewhere;
mod extension;
mod header;
mod install;
mod licences;
mod machine;
mod package;
mod platform;
mod portable;
mod prepare;
mod python;
mod site;
mod steps;
mod symbols;
mod test;
mod third_party;
mod web;
mod wheel;

use anyhow::Result;
use clap::{Parser, Subcommand};

#[derive(Parser)]
#[command(
    name = "cargo xtask",
    about = "Demo, tests, header and packages of Anyface"
)]
struct Cli {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// The installed extension in headless Blender, any version.
    Addon(addon::Addon),
    /// A talking head in a .blend, a contact sheet and a film, from nothing.
    Demo(demo::Demo),
    /// What makes the numbers and pictures of the documents, and which are older than the models.
    Docs(docs::Docs),
    /// The Blender extension as a zip.
    Extension(extension::Extension),
    /// include/anyface.h from the C interface's sources.
    Header(header::Header),
    /// The C library below a prefix, for pkg-config and CMake.
    Install(install::Install),
    /// THIRD-PARTY.md, the licences of the linked crates, by cargo-about.
    Licences(licences::Licences),
    /// What is handed out for this system: zip, wheel, C library, Debian package.
    Package(package::Package),
    /// What the tests install: Python environments, and Blender as a program.
    Prepare(prepare::Prepare),
    /// All that is handed out as a folder for any host of files.
    Site(site::Site),
    /// Lints and all tests; installs what they need.
    Test(test::Test),
    /// The library as WebAssembly, its npm package, and the page that makes heads talk.
    Web(web::Web),
    /// The Python package as a wheel.
    Wheel(wheel::Wheel),
}

fn main() -> Result<()> {
    match Cli::parse().task {
        Task::Addon(addon) => addon.run(),
        Task::Demo(demo) => demo.run(),
        Task::Docs(docs) => docs.run(),
        Task::Extension(extension) => extension.run(),
        Task::Header(header) => header.run(),
        Task::Install(install) => install.run(),
        Task::Licences(licences) => licences.run(),
        Task::Package(package) => package.run(),
        Task::Prepare(prepare) => prepare.run(),
        Task::Site(site) => site.run(),
        Task::Test(test) => test.run(),
        Task::Web(web) => web.run(),
        Task::Wheel(wheel) => wheel.run(),
    }
}
