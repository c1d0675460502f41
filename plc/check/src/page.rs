//! Pins of a block and members of a structure, from their source: `plc/package.py` puts them into `plc/blocks.md`.

/// A pin or a member with its comment.
#[derive(Clone, Debug)]
pub struct Pin {
    /// Name.
    pub name: String,
    /// Type.
    pub ty: String,
    /// Comment in one line.
    pub comment: String,
}

/// Inputs of a source file, and its outputs.
pub fn pins(text: &str) -> [Vec<Pin>; 2] {
    ["VAR_INPUT\n", "VAR_OUTPUT\n"].map(|block| {
        let within = text.split_once(block).and_then(|(_, rest)| rest.split_once("END_VAR"));
        declarations(within.map_or("", |(within, _)| within))
    })
}

/// Members of a structure.
pub fn members(text: &str) -> Vec<Pin> {
    let within = text.split_once("STRUCT\n").and_then(|(_, rest)| rest.split_once("END_STRUCT"));
    declarations(within.map_or("", |(within, _)| within))
}

fn declarations(text: &str) -> Vec<Pin> {
    let (mut all, mut rest) = (vec![], text.trim_start());
    while let Some((declaration, after)) = rest.split_once(';') {
        let (name, ty) = declaration.split_once(':').unwrap_or((declaration, ""));
        let ty = ty.split(":=").next().unwrap_or_default();
        let after = after.trim_start_matches(' ');
        let (comment, after) = match after.strip_prefix("(*").and_then(|after| after.split_once("*)")) {
            Some((comment, after)) => (comment.split_whitespace().collect::<Vec<_>>().join(" "), after),
            None => (String::new(), after),
        };
        all.push(Pin { name: name.trim().into(), ty: ty.trim().into(), comment });
        rest = after.trim_start();
    }
    all
}
