//! Addresses that `foreign/driver.c` needs of the library under another maker's compiler: the place of each variable of
//! each block. Written to standard output: `cargo run -p glapp-plc-check --example foreign -- matiec|strucpp
//! LREAL|REAL`.

use glapp_plc_check::{Build, Library, Variable, Within, sources};
use std::path::Path;

/// C expression for a variable of `*o`.
fn place(variable: &Variable, matiec: bool) -> String {
    let mut out = String::from("o->");
    for (number, (name, within)) in variable.parts.iter().enumerate() {
        let name = name.to_uppercase();
        let next = variable.parts.get(number + 1).map(|(_, within)| *within);
        match within {
            Within::Block | Within::Structure => {
                let dot = if number > 0 { "." } else { "" };
                // matiec puts a flag beside each variable of a block, but not beside a block, nor within a structure.
                let value = matiec && *within == Within::Block && next != Some(Within::Block);
                out += &format!("{dot}{name}{}", if value { ".value" } else { "" });
            }
            Within::Array if matiec => out += &format!(".table[{name}]"),
            Within::Array => out += &format!("[{name}]"),
        }
    }
    // A constant is const there.
    if matiec { format!("&{out}") } else { format!("(void *){out}.raw_ptr()") }
}

fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [compiler, build] = &args[..] else { panic!("matiec or strucpp, LREAL or REAL") };
    let matiec = compiler == "matiec";
    let build = if build == "REAL" { Build::Real } else { Build::Lreal };
    let home = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = sources(&home.join(".."), build).expect("the library");
    let tries = std::fs::read_to_string(home.join("tests/tries/TryFunctions.st")).expect("a file");
    files.push(("TryFunctions.st".into(), tries));
    let library = Library::of(files.iter().map(|(name, text)| (&**name, &**text)), build).expect("the library");
    let mut list = String::new();
    for name in library.blocks() {
        let program = ["GlappSelfTest", "GlappDemo", "GlappLoop"].contains(&name);
        let upper = name.to_uppercase();
        let kind = if program && !matiec { format!("Program_{upper}") } else { upper.clone() };
        let (make, call) = match matiec {
            true => (format!("{kind}_init__(o, 0);"), format!("{kind}_body__(o);")),
            false => (format!("new (o) {kind}();"), if program { "o->run();".into() } else { "(*o)();".to_owned() }),
        };
        println!("static void make_{upper}(void *at) {{ {kind} *o = ({kind} *)at; {make} }}");
        println!("static void call_{upper}(void *at) {{ {kind} *o = ({kind} *)at; {call} }}");
        let variables = library.variables(name);
        println!("static void *place_{upper}(void *at, int i) {{\n    {kind} *o = ({kind} *)at;\n    switch (i) {{");
        for (number, variable) in variables.iter().enumerate() {
            println!("    case {number}: return {};", place(variable, matiec));
        }
        println!("    }}\n    return 0;\n}}");
        println!("static const struct variable of_{upper}[] = {{");
        for variable in &variables {
            println!("    {{\"{}\", '{}', {}}},", variable.path(), &variable.ty[..1], i32::from(variable.retained));
        }
        println!("}};");
        list += &format!(
            "    {{\"{name}\", sizeof({kind}), {}, of_{upper}, make_{upper}, call_{upper}, place_{upper}}},\n",
            variables.len()
        );
    }
    println!("static const struct block blocks[] = {{\n{list}}};");
}
