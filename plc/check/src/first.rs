//! The tree by the crate `iecst`.

use crate::tree::{Argument, Class, Expr, Fault, Op, Pou, Stmt, StmtKind, Type, Unit, Var, VarBlock};
use iecst::{BinaryOp, ExprKind, PouKind, RetainKind, TypeDef, TypeKind, UnaryOp, VarBlockKind};

/// Reads one file: a `TYPE` with one structure, a function, a function block, or a program.
pub fn parse(place: &str, text: &str) -> Result<Unit, Fault> {
    Reader { place, text }.unit()
}

struct Reader<'a> {
    place: &'a str,
    text: &'a str,
}

impl Reader<'_> {
    fn line(&self, at: usize) -> usize {
        1 + self.text.as_bytes()[..at.min(self.text.len())].iter().filter(|b| **b == b'\n').count()
    }

    fn fault<T>(&self, line: usize, what: impl Into<String>) -> Result<T, Fault> {
        Err(Fault::new(self.place, line, what))
    }

    fn unit(&self) -> Result<Unit, Fault> {
        let refused = |e: iecst::ParseError| Fault::new(self.place, self.line(e.span.start), format!("{:?}", e.kind));
        if crate::lint::words(self.text).next().is_some_and(|word| word == "TYPE") {
            let types = iecst::parse_type_block(self.text).map_err(refused)?;
            return match <[_; 1]>::try_from(types) {
                Ok([one]) => match one.definition {
                    TypeDef::Struct { fields } => Ok(Unit::Struct { name: one.name, fields: self.vars(fields)? }),
                    _ => self.fault(1, "only STRUCT is in the subset"),
                },
                Err(_) => self.fault(1, "one type a file"),
            };
        }
        let pou = iecst::parse_pou(self.text).map_err(refused)?;
        let returns = match (pou.kind, pou.return_type) {
            (PouKind::FunctionBlock | PouKind::Program, None) => None,
            (PouKind::Function, Some(ty)) => Some(self.ty(ty.kind)?),
            _ => return self.fault(1, "not a function with a type, nor a function block or a program"),
        };
        let blocks = pou.var_blocks.into_iter().map(|block| self.block(block)).collect::<Result<_, _>>()?;
        let program = pou.kind == PouKind::Program;
        Ok(Unit::Pou(Pou { name: pou.name, program, returns, blocks, body: self.body(pou.body)? }))
    }

    fn block(&self, block: iecst::VarBlock) -> Result<VarBlock, Fault> {
        let class = match block.kind {
            VarBlockKind::VarInput => Class::Input,
            VarBlockKind::VarOutput => Class::Output,
            VarBlockKind::Var => Class::Local,
            other => return self.fault(self.line(block.span.start), format!("{other:?} is not in the subset")),
        };
        let retain = block.retain == RetainKind::Retain;
        Ok(VarBlock { class, constant: block.constant, retain, vars: self.vars(block.vars)? })
    }

    fn vars(&self, vars: Vec<iecst::VarDecl>) -> Result<Vec<Var>, Fault> {
        vars.into_iter()
            .map(|var| {
                let initial = var.initial.map(|e| self.expr(e)).transpose()?;
                Ok(Var { name: var.name, ty: self.ty(var.var_type.kind)?, initial })
            })
            .collect()
    }

    fn ty(&self, ty: TypeKind) -> Result<Type, Fault> {
        match ty {
            TypeKind::Simple(name) => Ok(Type::Named(name)),
            TypeKind::Array { ranges, element } => {
                let (Ok([range]), TypeKind::Simple(element)) = (<[_; 1]>::try_from(ranges), element.kind) else {
                    return self.fault(0, "an array has one index and plain elements");
                };
                match (self.expr(range.low)?, self.expr(range.high)?) {
                    (Expr::Int(low), Expr::Int(high)) => Ok(Type::Array { low, high, element }),
                    _ => self.fault(0, "bounds of an array are literals"),
                }
            }
            other => self.fault(0, format!("type {other:?} is not in the subset")),
        }
    }

    fn body(&self, body: Vec<iecst::Stmt>) -> Result<Vec<Stmt>, Fault> {
        body.into_iter().filter(|s| s.kind != iecst::StmtKind::Empty).map(|s| self.stmt(s)).collect()
    }

    fn stmt(&self, stmt: iecst::Stmt) -> Result<Stmt, Fault> {
        let line = self.line(stmt.span.start);
        let kind = match stmt.kind {
            iecst::StmtKind::Assignment { target, value } => StmtKind::Assign(self.expr(target)?, self.expr(value)?),
            iecst::StmtKind::If { condition, then_body, elsif_branches, else_body } => {
                let mut branches = vec![(self.expr(condition)?, self.body(then_body)?)];
                for (condition, body) in elsif_branches {
                    branches.push((self.expr(condition)?, self.body(body)?));
                }
                StmtKind::If(branches, self.body(else_body.unwrap_or_default())?)
            }
            iecst::StmtKind::For { var, from, to, by, body } => StmtKind::For {
                var,
                from: self.expr(from)?,
                to: self.expr(to)?,
                by: by.map(|e| self.expr(e)).transpose()?,
                body: self.body(body)?,
            },
            iecst::StmtKind::While { condition, body } => StmtKind::While(self.expr(condition)?, self.body(body)?),
            iecst::StmtKind::Call { name, args } => {
                let args = args.into_iter().map(|a| self.argument(line, a.name, a.value)).collect::<Result<_, _>>()?;
                StmtKind::Call(name, args)
            }
            other => {
                let text = format!("{other:?}");
                return self
                    .fault(line, format!("{} is not in the subset", text.split([' ', '{']).next().unwrap_or("")));
            }
        };
        Ok(Stmt { line, kind })
    }

    fn argument(&self, line: usize, name: Option<String>, value: Option<iecst::Expr>) -> Result<Argument, Fault> {
        match value {
            Some(value) => Ok((name, self.expr(value)?)),
            None => self.fault(line, "an argument is empty"),
        }
    }

    fn expr(&self, expr: iecst::Expr) -> Result<Expr, Fault> {
        let line = self.line(expr.span.start);
        let boxed = |e: Box<iecst::Expr>| self.expr(*e).map(Box::new);
        Ok(match expr.kind {
            ExprKind::IntLiteral(x) => Expr::Int(x),
            ExprKind::RealLiteral(x) => Expr::Real(x),
            ExprKind::BoolLiteral(x) => Expr::Bool(x),
            ExprKind::Ident(name) => Expr::Name(name),
            ExprKind::Paren(inner) => Expr::Paren(boxed(inner)?),
            ExprKind::UnaryOp { op: UnaryOp::Neg, expr } => self.expr(*expr)?.negated(),
            ExprKind::UnaryOp { op: UnaryOp::Not, expr } => Expr::Not(boxed(expr)?),
            ExprKind::BinaryOp { left, op, right } => {
                let op = match op {
                    BinaryOp::Add => Op::Add,
                    BinaryOp::Sub => Op::Sub,
                    BinaryOp::Mul => Op::Mul,
                    BinaryOp::Div => Op::Div,
                    BinaryOp::Mod => Op::Mod,
                    BinaryOp::Eq => Op::Eq,
                    BinaryOp::Ne => Op::Ne,
                    BinaryOp::Lt => Op::Lt,
                    BinaryOp::Le => Op::Le,
                    BinaryOp::Gt => Op::Gt,
                    BinaryOp::Ge => Op::Ge,
                    BinaryOp::And => Op::And,
                    BinaryOp::Or => Op::Or,
                    BinaryOp::Xor => Op::Xor,
                    BinaryOp::Power => return self.fault(line, "** is not in the subset"),
                };
                Expr::Binary(op, boxed(left)?, boxed(right)?)
            }
            ExprKind::FunctionCall { name, args } => {
                let args = args.into_iter().map(|a| self.argument(line, a.name, a.value)).collect::<Result<_, _>>()?;
                Expr::Call(name, args)
            }
            ExprKind::ArrayIndex { array, indices } => match <[_; 1]>::try_from(indices) {
                Ok([index]) => Expr::Index(boxed(array)?, Box::new(self.expr(index)?)),
                Err(_) => return self.fault(line, "an array has one index"),
            },
            ExprKind::MemberAccess { expr, member } => Expr::Member(boxed(expr)?, member),
            other => return self.fault(line, format!("{other:?} is not in the subset")),
        })
    }
}
