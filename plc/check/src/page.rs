//! Pins of a block and members of a structure as tables, from their source: `plc/blocks.md` has them.

/// Inputs and outputs of a source file as a table in Markdown: pin, type, what it begins with, and its comment.
pub fn pins(text: &str) -> String {
    let mut rows = vec!["| pin | | type | begins with | |".to_owned(), "|---|---|---|---|---|".to_owned()];
    for (block, way) in [("VAR_INPUT", "in"), ("VAR_OUTPUT", "out")] {
        let Some((_, rest)) = text.split_once(&format!("{block}\n")) else { continue };
        for [name, ty, initial, comment] in declarations(rest.split_once("END_VAR").map_or("", |(within, _)| within)) {
            rows.push(format!("| {name} | {way} | {ty} | {initial} | {comment} |"));
        }
    }
    rows.join("\n")
}

/// Members of a structure likewise.
pub fn members(text: &str) -> String {
    let mut rows = vec!["| member | type | begins with | |".to_owned(), "|---|---|---|---|".to_owned()];
    let within = text.split_once("STRUCT\n").and_then(|(_, rest)| rest.split_once("END_STRUCT"));
    for [name, ty, initial, comment] in declarations(within.map_or("", |(within, _)| within)) {
        rows.push(format!("| {name} | {ty} | {initial} | {comment} |"));
    }
    rows.join("\n")
}

/// Name, type, what it begins with, and comment of each declaration.
fn declarations(text: &str) -> Vec<[String; 4]> {
    let (mut all, mut rest) = (vec![], text.trim_start());
    while let Some((declaration, after)) = rest.split_once(';') {
        let (name, ty) = declaration.split_once(':').unwrap_or((declaration, ""));
        let (ty, initial) = ty.split_once(":=").unwrap_or((ty, ""));
        let after = after.trim_start_matches(' ');
        let (comment, after) = match after.strip_prefix("(*").and_then(|after| after.split_once("*)")) {
            Some((comment, after)) => (comment.split_whitespace().collect::<Vec<_>>().join(" "), after),
            None => (String::new(), after),
        };
        all.push([name.trim().into(), ty.trim().into(), initial.trim().into(), comment]);
        rest = after.trim_start();
    }
    all
}
