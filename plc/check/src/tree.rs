//! The tree of a source file, the same from both parsers: what the linter looks at and the evaluator is made from.

use std::fmt;

/// Content of one file.
#[derive(Clone, Debug, PartialEq)]
pub enum Unit {
    /// `TYPE … STRUCT`.
    Struct {
        /// Name.
        name: String,
        /// Fields.
        fields: Vec<Var>,
    },
    /// `FUNCTION`, `FUNCTION_BLOCK` or `PROGRAM`.
    Pou(Pou),
}

impl Unit {
    /// The name that the file declares.
    pub fn name(&self) -> &str {
        match self {
            Self::Struct { name, .. } | Self::Pou(Pou { name, .. }) => name,
        }
    }
}

/// A function, a function block or a program.
#[derive(Clone, Debug, PartialEq)]
pub struct Pou {
    /// Name.
    pub name: String,
    /// A program: a block of which there is one.
    pub program: bool,
    /// The type that a function gives; none for the others.
    pub returns: Option<Type>,
    /// Declarations.
    pub blocks: Vec<VarBlock>,
    /// Statements.
    pub body: Vec<Stmt>,
}

/// Visibility of a variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    /// `VAR_INPUT`.
    Input,
    /// `VAR_OUTPUT`.
    Output,
    /// `VAR`.
    Local,
}

/// `VAR … END_VAR`.
#[derive(Clone, Debug, PartialEq)]
pub struct VarBlock {
    /// Visibility.
    pub class: Class,
    /// `CONSTANT`.
    pub constant: bool,
    /// `RETAIN`.
    pub retain: bool,
    /// Variables.
    pub vars: Vec<Var>,
}

/// A declaration.
#[derive(Clone, Debug, PartialEq)]
pub struct Var {
    /// Name.
    pub name: String,
    /// Type.
    pub ty: Type,
    /// Initial value; none: 0 or FALSE.
    pub initial: Option<Expr>,
}

/// A type as it is written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Type {
    /// A type by its name.
    Named(String),
    /// `ARRAY[low..high] OF element`.
    Array {
        /// First index.
        low: i64,
        /// Last index.
        high: i64,
        /// Name of the elements' type.
        element: String,
    },
}

/// A statement and the line it begins in.
#[derive(Clone, Debug)]
pub struct Stmt {
    /// Line, from 1.
    pub line: usize,
    /// Kind.
    pub kind: StmtKind,
}

/// Comparison without line numbers: a package may break its lines elsewhere.
impl PartialEq for Stmt {
    fn eq(&self, other: &Self) -> bool {
        self.kind == other.kind
    }
}

/// The statements of the subset.
#[derive(Clone, Debug, PartialEq)]
pub enum StmtKind {
    /// `target := value;`
    Assign(Expr, Expr),
    /// `IF … ELSIF … ELSE … END_IF;`
    If(Vec<(Expr, Vec<Stmt>)>, Vec<Stmt>),
    /// `FOR var := from TO to BY by DO … END_FOR;`
    For {
        /// The variable that counts.
        var: String,
        /// First value.
        from: Expr,
        /// Last value.
        to: Expr,
        /// Step; none: 1.
        by: Option<Expr>,
        /// Repeated statements.
        body: Vec<Stmt>,
    },
    /// `WHILE … DO … END_WHILE;`
    While(Expr, Vec<Stmt>),
    /// `Instance(Pin := value, …);`
    Call(String, Vec<Argument>),
}

/// An argument, with the pin where it is named.
pub type Argument = (Option<String>, Expr);

/// An expression.
#[derive(Clone, Debug, PartialEq)]
pub enum Expr {
    /// A whole number, of no type yet.
    Int(i64),
    /// A number with a point, of no type yet.
    Real(f64),
    /// TRUE or FALSE.
    Bool(bool),
    /// A variable.
    Name(String),
    /// `of.field`.
    Member(Box<Expr>, String),
    /// `of[index]`.
    Index(Box<Expr>, Box<Expr>),
    /// `-x`.
    Neg(Box<Expr>),
    /// `NOT x`.
    Not(Box<Expr>),
    /// `a op b`.
    Binary(Op, Box<Expr>, Box<Expr>),
    /// `Function(a, …)`.
    Call(String, Vec<Argument>),
    /// `(x)`.
    Paren(Box<Expr>),
}

/// Operators of two operands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Op {
    Add,
    Sub,
    Mul,
    Div,
    Mod,
    Eq,
    Ne,
    Lt,
    Le,
    Gt,
    Ge,
    And,
    Or,
    Xor,
}

impl Op {
    /// Symbol in the source.
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Add => "+",
            Self::Sub => "-",
            Self::Mul => "*",
            Self::Div => "/",
            Self::Mod => "MOD",
            Self::Eq => "=",
            Self::Ne => "<>",
            Self::Lt => "<",
            Self::Le => "<=",
            Self::Gt => ">",
            Self::Ge => ">=",
            Self::And => "AND",
            Self::Or => "OR",
            Self::Xor => "XOR",
        }
    }

    /// The operator that is written so.
    pub fn of(symbol: &str) -> Option<Self> {
        const ALL: [Op; 14] = [
            Op::Add,
            Op::Sub,
            Op::Mul,
            Op::Div,
            Op::Mod,
            Op::Eq,
            Op::Ne,
            Op::Lt,
            Op::Le,
            Op::Gt,
            Op::Ge,
            Op::And,
            Op::Or,
            Op::Xor,
        ];
        ALL.into_iter().find(|op| op.symbol().eq_ignore_ascii_case(symbol))
    }
}

impl Expr {
    /// A sign before a literal belongs to the literal: one parser reads it so, the other does not.
    pub(crate) fn negated(self) -> Self {
        match self {
            Self::Int(x) => Self::Int(-x),
            Self::Real(x) => Self::Real(-x),
            other => Self::Neg(Box::new(other)),
        }
    }
}

/// Why a source is refused, or a run stopped: the file or POU, the line where it is known, and what is wrong there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// File or POU.
    pub place: String,
    /// Line, from 1; 0 where it is not known.
    pub line: usize,
    /// Error in words.
    pub what: String,
}

impl Fault {
    pub(crate) fn new(place: &str, line: usize, what: impl Into<String>) -> Self {
        Self { place: place.to_owned(), line, what: what.into() }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.line > 0 {
            write!(f, "{}:{}: {}", self.place, self.line, self.what)
        } else {
            write!(f, "{}: {}", self.place, self.what)
        }
    }
}

impl std::error::Error for Fault {}
