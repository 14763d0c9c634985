//! `anyface parts`: the parts of a mesh and what each of them is.

use anyface::{
    Result,
    mesh::{NamedMesh, Part},
};
use clap::Args;

use crate::{
    arguments::{FaceArgs, SharedArgs},
    console::Console,
    paths::InputPath,
};

/// List the parts of a mesh (teeth, eyes, lashes, …) and what each of them follows
#[derive(Args)]
pub struct ListParts {
    /// The mesh: OBJ, PLY, GLB, VRM or glTF
    #[arg(long, value_name = "M")]
    mesh: InputPath,
    #[command(flatten)]
    face: FaceArgs,
}

impl ListParts {
    pub fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        let named = NamedMesh::read(&self.mesh)?;
        let mut warnings = Vec::new();
        let file = (&*self.mesh, &named);
        let options = self.face.options(file, None, &mut warnings)?;
        console.warn(&warnings);
        let face = shared
            .engine()?
            .find(&named.mesh, &options, &|p| console.progress(p))?;
        let list = &face.parts;
        let mut text = format!(
            "{:>4} {:<8} {:>8}  {:<32} name\n",
            "part", "role", "vertices", "middle"
        );
        list.parts.iter().for_each(|part| text += &line(part));
        console.value(&serde_json::json!({"parts": list.parts}), &text)
    }
}

fn line(part: &Part) -> String {
    let middle = [0, 1, 2].map(|i| format!("{:.4}", 0.5 * (part.low[i] + part.high[i])));
    format!(
        "{:>4} {:<8} {:>8}  {:<32} {}\n",
        part.number,
        part.role.name(),
        part.vertices,
        middle.join(" "),
        part.name.as_deref().unwrap_or("-")
    )
}
