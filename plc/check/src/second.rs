//! The tree by the crate `tree-sitter-iec61131-3-st`.

use crate::tree::{Argument, Class, Expr, Fault, Op, Pou, Stmt, StmtKind, Type, Unit, Var, VarBlock};
use tree_sitter::{Node, Parser};

/// Reads one file: a `TYPE` with one structure, a function, a function block, or a program.
pub fn parse(place: &str, text: &str) -> Result<Unit, Fault> {
    let mut parser = Parser::new();
    let grammar = tree_sitter_iec61131_3_st::LANGUAGE.into();
    parser.set_language(&grammar).map_err(|e| Fault::new(place, 0, e.to_string()))?;
    let Some(tree) = parser.parse(text, None) else {
        return Err(Fault::new(place, 0, "not read"));
    };
    let reader = Reader { place, text };
    let root = tree.root_node();
    if root.has_error() {
        return Err(Fault::new(place, error_line(root), "no Structured Text"));
    }
    match <[_; 1]>::try_from(children(root)) {
        Ok([one]) => reader.unit(one),
        Err(_) => Err(Fault::new(place, 0, "one unit a file")),
    }
}

fn error_line(node: Node<'_>) -> usize {
    if node.is_error() || node.is_missing() {
        return node.start_position().row + 1;
    }
    let mut cursor = node.walk();
    node.children(&mut cursor).filter(|n| n.has_error() || n.is_missing()).map(error_line).next().unwrap_or(0)
}

/// The named nodes within, without comments.
fn children(node: Node<'_>) -> Vec<Node<'_>> {
    let mut cursor = node.walk();
    node.named_children(&mut cursor).filter(|n| n.kind() != "comment").collect()
}

struct Reader<'a> {
    place: &'a str,
    text: &'a str,
}

impl<'a> Reader<'a> {
    fn text(&self, node: Node<'_>) -> &'a str {
        &self.text[node.byte_range()]
    }

    fn fault<T>(&self, node: Node<'_>, what: impl Into<String>) -> Result<T, Fault> {
        Err(Fault::new(self.place, node.start_position().row + 1, what))
    }

    fn field<'n>(&self, node: Node<'n>, name: &str) -> Result<Node<'n>, Fault> {
        match node.child_by_field_name(name) {
            Some(found) => Ok(found),
            None => self.fault(node, format!("no {name}")),
        }
    }

    fn fields<'n>(&self, node: Node<'n>, name: &str) -> Vec<Node<'n>> {
        let mut cursor = node.walk();
        node.children_by_field_name(name, &mut cursor).filter(|n| n.is_named() && n.kind() != "comment").collect()
    }

    fn unit(&self, node: Node<'_>) -> Result<Unit, Fault> {
        let name = |node| self.field(node, "name").map(|n| self.text(n).to_owned());
        match node.kind() {
            "type_declaration" => match <[_; 1]>::try_from(children(node)) {
                Ok([one]) => {
                    let definition = self.field(one, "definition")?;
                    let fields = children(definition)
                        .into_iter()
                        .map(|f| self.var(f, "name", "default"))
                        .collect::<Result<_, _>>()?;
                    Ok(Unit::Struct { name: name(one)?, fields })
                }
                Err(_) => self.fault(node, "one type a file"),
            },
            "function_declaration" | "function_block_declaration" | "program_declaration" => {
                let returns = node.child_by_field_name("return_type").map(|n| self.ty(n)).transpose()?;
                let blocks = children(node).into_iter().filter(|n| n.kind().starts_with("var_"));
                let blocks = blocks.map(|n| self.block(n)).collect::<Result<_, _>>()?;
                let program = node.kind() == "program_declaration";
                Ok(Unit::Pou(Pou { name: name(node)?, program, returns, blocks, body: self.body(node, "body")? }))
            }
            other => self.fault(node, format!("{other} is not in the subset")),
        }
    }

    fn block(&self, node: Node<'_>) -> Result<VarBlock, Fault> {
        let class = match node.kind() {
            "var_input" => Class::Input,
            "var_output" => Class::Output,
            "var_block" => Class::Local,
            other => return self.fault(node, format!("{other} is not in the subset")),
        };
        let (mut constant, mut retain, mut vars) = (false, false, vec![]);
        for child in children(node) {
            if child.kind() == "var_qualifier_list" {
                constant |= self.text(child) == "CONSTANT";
                retain |= self.text(child) == "RETAIN";
            } else {
                vars.push(self.var(child, "names", "initial_value")?);
            }
        }
        Ok(VarBlock { class, constant, retain, vars })
    }

    fn var(&self, node: Node<'_>, name: &str, initial: &str) -> Result<Var, Fault> {
        let names = self.fields(node, name);
        let [one] = names[..] else { return self.fault(node, "one name a declaration") };
        let initial = node.child_by_field_name(initial).map(|n| self.expr(n)).transpose()?;
        Ok(Var { name: self.text(one).to_owned(), ty: self.ty(self.field(node, "type")?)?, initial })
    }

    fn ty(&self, node: Node<'_>) -> Result<Type, Fault> {
        match node.kind() {
            "elementary_type" | "identifier" => Ok(Type::Named(self.text(node).to_owned())),
            "array_type" => {
                let ranges = self.fields(node, "range");
                let [range] = ranges[..] else { return self.fault(node, "an array has one index") };
                let bound = |name| self.field(range, name).and_then(|n| self.expr(n));
                match (bound("lower")?, bound("upper")?) {
                    (Expr::Int(low), Expr::Int(high)) => {
                        let element = self.text(self.field(node, "element_type")?).to_owned();
                        Ok(Type::Array { low, high, element })
                    }
                    _ => self.fault(node, "bounds of an array are literals"),
                }
            }
            other => self.fault(node, format!("{other} is not in the subset")),
        }
    }

    fn body(&self, node: Node<'_>, field: &str) -> Result<Vec<Stmt>, Fault> {
        let statements = self.fields(node, field).into_iter().filter(|n| n.kind() != "empty_statement");
        statements.map(|n| self.stmt(n)).collect()
    }

    fn stmt(&self, node: Node<'_>) -> Result<Stmt, Fault> {
        let of = |name| self.field(node, name).and_then(|n| self.expr(n));
        let kind = match node.kind() {
            "assignment_statement" => StmtKind::Assign(of("left")?, of("right")?),
            "invocation_statement" => match children(node).first().map(|call| self.expr(*call)).transpose()? {
                Some(Expr::Call(name, args)) => StmtKind::Call(name, args),
                _ => return self.fault(node, "a call"),
            },
            "if_statement" => {
                let mut branches = vec![(of("condition")?, self.body(node, "consequence")?)];
                let mut otherwise = vec![];
                for clause in children(node) {
                    match clause.kind() {
                        "elsif_clause" => {
                            let condition = self.expr(self.field(clause, "condition")?)?;
                            branches.push((condition, self.body(clause, "body")?));
                        }
                        "else_clause" => otherwise = self.body(clause, "body")?,
                        _ => {}
                    }
                }
                StmtKind::If(branches, otherwise)
            }
            "for_statement" => StmtKind::For {
                var: self.text(self.field(node, "control")?).to_owned(),
                from: of("start")?,
                to: of("end")?,
                by: node.child_by_field_name("step").map(|n| self.expr(n)).transpose()?,
                body: self.body(node, "body")?,
            },
            "while_statement" => StmtKind::While(of("condition")?, self.body(node, "body")?),
            other => return self.fault(node, format!("{other} is not in the subset")),
        };
        Ok(Stmt { line: node.start_position().row + 1, kind })
    }

    fn expr(&self, node: Node<'_>) -> Result<Expr, Fault> {
        let text = self.text(node);
        let of = |name| self.field(node, name).and_then(|n| self.expr(n)).map(Box::new);
        Ok(match node.kind() {
            "integer_literal" => match text.parse() {
                Ok(x) => Expr::Int(x),
                Err(_) => return self.fault(node, format!("{text} is no whole number")),
            },
            "real_literal" => match text.parse() {
                Ok(x) => Expr::Real(x),
                Err(_) => return self.fault(node, format!("{text} is no number")),
            },
            "boolean_literal" => Expr::Bool(text == "TRUE"),
            "identifier" => Expr::Name(text.to_owned()),
            "parenthesized_expression" => match children(node)[..] {
                [inner] => Expr::Paren(Box::new(self.expr(inner)?)),
                _ => return self.fault(node, "one expression in parentheses"),
            },
            "unary_expression" => match self.text(self.field(node, "operator")?) {
                "-" => of("operand")?.negated(),
                "NOT" => Expr::Not(of("operand")?),
                other => return self.fault(node, format!("{other} is not in the subset")),
            },
            "binary_expression" => match Op::of(self.text(self.field(node, "operator")?)) {
                Some(op) => Expr::Binary(op, of("left")?, of("right")?),
                None => return self.fault(node, "operator is not in the subset"),
            },
            "member_access_expression" => {
                Expr::Member(of("object")?, self.text(self.field(node, "member")?).to_owned())
            }
            "index_expression" => match self.fields(node, "index")[..] {
                [index] => Expr::Index(of("object")?, Box::new(self.expr(index)?)),
                _ => return self.fault(node, "an array has one index"),
            },
            "call_expression" => {
                let args = children(self.field(node, "arguments")?);
                let args = args.into_iter().map(|n| self.argument(n)).collect::<Result<_, _>>()?;
                Expr::Call(self.text(self.field(node, "function")?).to_owned(), args)
            }
            other => return self.fault(node, format!("{other} is not in the subset")),
        })
    }

    fn argument(&self, node: Node<'_>) -> Result<Argument, Fault> {
        if node.kind() == "named_argument" {
            let name = self.text(self.field(node, "name")?).to_owned();
            return Ok((Some(name), self.expr(self.field(node, "value")?)?));
        }
        Ok((None, self.expr(node)?))
    }
}
