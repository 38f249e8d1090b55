//! The places of a file where a mutant can stand, found in its syntax tree.
//!
//! Left out: tests and what `cfg` may switch off, `const` and `static` items, `const fn`, array lengths, types,
//! patterns, attributes, `Debug`, and the arguments of `with_capacity` and `reserve` (they change no result). Of macros
//! only the condition of `ensure!` and the elements of `vec!` are read.

use std::ops::Range;

use proc_macro2::Span;
use syn::parse::{ParseStream, Parser};
use syn::punctuated::Punctuated;
use syn::spanned::Spanned;
use syn::visit::{self, Visit};
use syn::{BinOp, Expr, Lit, Token, UnOp};

/// How a mutant is woven into the text of its place.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Form {
    /// Another expression in place of the expression.
    Expression,
    /// Nothing in place of the statement.
    Deletion,
}

/// One mutant that could be made.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// The bytes that it replaces.
    pub range: Range<usize>,
    pub line: usize,
    pub column: usize,
    pub kind: &'static str,
    pub form: Form,
    /// What stands there instead.
    pub replacement: String,
}

/// All candidates of a file, in the order of the text.
pub fn find_candidates(text: &str) -> syn::Result<Vec<Candidate>> {
    let file = syn::parse_file(text)?;
    let mut finder = Finder { text, found: Vec::new() };
    finder.visit_file(&file);
    finder.found.sort_by(|a, b| (a.range.start, a.range.end, a.kind).cmp(&(b.range.start, b.range.end, b.kind)));
    Ok(finder.found)
}

struct Finder<'a> {
    text: &'a str,
    found: Vec<Candidate>,
}

impl Finder<'_> {
    fn text_of(&self, node: &impl Spanned) -> &str {
        &self.text[node.span().byte_range()]
    }

    fn add(&mut self, span: Span, kind: &'static str, form: Form, replacement: String) {
        let (range, at) = (span.byte_range(), span.start());
        self.found.push(Candidate { range, line: at.line, column: at.column + 1, kind, form, replacement });
    }

    fn add_expression(&mut self, node: &impl Spanned, kind: &'static str, replacement: String) {
        self.add(node.span(), kind, Form::Expression, replacement);
    }

    fn add_binary(&mut self, node: &syn::ExprBinary) {
        use BinOp::*;
        let (kind, others): (_, &[&str]) = match node.op {
            Add(_) => ("arithmetic", &["-"]),
            Sub(_) => ("arithmetic", &["+"]),
            Mul(_) => ("arithmetic", &["/"]),
            Div(_) => ("arithmetic", &["*"]),
            Rem(_) => ("arithmetic", &["/"]),
            BitAnd(_) => ("bits", &["|"]),
            BitOr(_) | BitXor(_) => ("bits", &["&"]),
            Shl(_) => ("bits", &[">>"]),
            Shr(_) => ("bits", &["<<"]),
            Lt(_) => ("comparison", &["<=", ">="]),
            Le(_) => ("comparison", &["<", ">"]),
            Gt(_) => ("comparison", &[">=", "<="]),
            Ge(_) => ("comparison", &[">", "<"]),
            Eq(_) => ("comparison", &["!="]),
            Ne(_) => ("comparison", &["=="]),
            And(_) => ("logic", &["||"]),
            Or(_) => ("logic", &["&&"]),
            AddAssign(_) => ("compound assignment", &["-="]),
            SubAssign(_) => ("compound assignment", &["+="]),
            MulAssign(_) => ("compound assignment", &["/="]),
            DivAssign(_) => ("compound assignment", &["*="]),
            BitAndAssign(_) => ("compound assignment", &["|="]),
            BitOrAssign(_) | BitXorAssign(_) => ("compound assignment", &["&="]),
            ShlAssign(_) => ("compound assignment", &[">>="]),
            ShrAssign(_) => ("compound assignment", &["<<="]),
            _ => return,
        };
        for other in others {
            let (left, right) = (self.text_of(&node.left), self.text_of(&node.right));
            let replacement = match kind {
                // What is assigned to takes no parentheses.
                "compound assignment" => format!("{left} {other} ({right})"),
                _ => format!("({left}) {other} ({right})"),
            };
            self.add_expression(node, kind, replacement);
        }
    }

    fn add_condition(&mut self, condition: &Expr, values: &[&str]) {
        if !has_let(condition) {
            for value in values {
                self.add_expression(condition, "condition", (*value).to_owned());
            }
        }
    }

    /// What of a macro's arguments is an expression of ours.
    fn visit_arguments(&mut self, node: &syn::Macro) {
        let name = node.path.segments.last().map(|s| s.ident.to_string()).unwrap_or_default();
        let tokens = node.tokens.clone();
        let expressions: Vec<Expr> = match name.as_str() {
            "ensure" => {
                let condition = |input: ParseStream| -> syn::Result<Expr> {
                    input.parse::<syn::Path>()?;
                    input.parse::<Token![,]>()?;
                    let condition: Expr = input.parse()?;
                    input.parse::<proc_macro2::TokenStream>()?;
                    Ok(condition)
                };
                condition.parse2(tokens).into_iter().collect()
            }
            "vec" => {
                let repeated = |input: ParseStream| -> syn::Result<Vec<Expr>> {
                    let value: Expr = input.parse()?;
                    input.parse::<Token![;]>()?;
                    Ok(vec![value, input.parse()?])
                };
                let listed = Punctuated::<Expr, Token![,]>::parse_terminated;
                repeated
                    .parse2(tokens.clone())
                    .or_else(|_| listed.parse2(tokens).map(|list| list.into_iter().collect()))
                    .unwrap_or_default()
            }
            _ => return,
        };
        for expression in &expressions {
            if name == "ensure" {
                self.add_condition(expression, &["true"]);
            }
            self.visit_expr(expression);
        }
    }
}

/// Whether a condition binds names (`let` chains must stand as they are).
fn has_let(condition: &Expr) -> bool {
    match condition {
        Expr::Let(_) => true,
        Expr::Binary(b) => has_let(&b.left) || has_let(&b.right),
        Expr::Paren(p) => has_let(&p.expr),
        _ => false,
    }
}

/// Whether attributes make an item a test, or one that another platform compiles.
fn is_left_out(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|a| {
        let name = a.path().segments.last().map(|s| s.ident.to_string()).unwrap_or_default();
        let condition = match &a.meta {
            syn::Meta::List(list) => list.tokens.to_string(),
            _ => String::new(),
        };
        name == "test"
            || name == "cfg" && ["test", "not", "target_os", "windows"].iter().any(|word| condition.contains(word))
    })
}

/// One step of a literal: the next integer, a tenth more of a number (0.1 for zero).
fn other_literal(literal: &Lit) -> Option<String> {
    match literal {
        Lit::Int(n) => {
            let value: u128 = n.base10_parse().ok()?;
            Some(format!("{}{}", value.checked_add(1)?, n.suffix()))
        }
        Lit::Float(x) => {
            let value: f64 = x.base10_parse().ok()?;
            let other = if value == 0.0 { 0.1 } else { value * 1.1 };
            Some(format!("{other:e}{}", x.suffix()))
        }
        _ => None,
    }
}

impl<'ast> Visit<'ast> for Finder<'_> {
    fn visit_item(&mut self, node: &'ast syn::Item) {
        let attributes = match node {
            syn::Item::Fn(i) => &i.attrs,
            syn::Item::Mod(i) => &i.attrs,
            syn::Item::Impl(i) => &i.attrs,
            syn::Item::Trait(i) => &i.attrs,
            _ => return,
        };
        let debug = matches!(node, syn::Item::Impl(i) if i.trait_.as_ref().is_some_and(|(_, path, _)| {
            path.segments.last().is_some_and(|s| s.ident == "Debug")
        }));
        let constant = matches!(node, syn::Item::Fn(f) if f.sig.constness.is_some());
        if !is_left_out(attributes) && !debug && !constant {
            visit::visit_item(self, node);
        }
    }

    fn visit_impl_item(&mut self, node: &'ast syn::ImplItem) {
        if let syn::ImplItem::Fn(f) = node
            && f.sig.constness.is_none()
            && !is_left_out(&f.attrs)
        {
            visit::visit_block(self, &f.block);
        }
    }

    fn visit_trait_item(&mut self, node: &'ast syn::TraitItem) {
        if let syn::TraitItem::Fn(f) = node
            && let Some(block) = &f.default
        {
            visit::visit_block(self, block);
        }
    }

    fn visit_attribute(&mut self, _: &'ast syn::Attribute) {}
    fn visit_type(&mut self, _: &'ast syn::Type) {}
    fn visit_pat(&mut self, _: &'ast syn::Pat) {}
    fn visit_path(&mut self, _: &'ast syn::Path) {}
    fn visit_expr_const(&mut self, _: &'ast syn::ExprConst) {}
    fn visit_signature(&mut self, _: &'ast syn::Signature) {}

    fn visit_macro(&mut self, node: &'ast syn::Macro) {
        self.visit_arguments(node);
    }

    fn visit_stmt(&mut self, node: &'ast syn::Stmt) {
        if let syn::Stmt::Expr(Expr::MethodCall(_) | Expr::Call(_) | Expr::Assign(_), Some(_)) = node {
            self.add(node.span(), "deletion", Form::Deletion, String::new());
        }
        visit::visit_stmt(self, node);
    }

    fn visit_expr_binary(&mut self, node: &'ast syn::ExprBinary) {
        if !has_let(&node.left) && !has_let(&node.right) {
            self.add_binary(node);
        }
        visit::visit_expr_binary(self, node);
    }

    fn visit_expr_unary(&mut self, node: &'ast syn::ExprUnary) {
        match node.op {
            UnOp::Neg(_) => self.add_expression(node, "negation", self.text_of(&node.expr).to_owned()),
            UnOp::Not(_) => self.add_expression(node, "negation", self.text_of(&node.expr).to_owned()),
            _ => {}
        }
        visit::visit_expr_unary(self, node);
    }

    fn visit_expr_if(&mut self, node: &'ast syn::ExprIf) {
        self.add_condition(&node.cond, &["true", "false"]);
        visit::visit_expr_if(self, node);
    }

    fn visit_expr_while(&mut self, node: &'ast syn::ExprWhile) {
        self.add_condition(&node.cond, &["false"]);
        visit::visit_expr_while(self, node);
    }

    fn visit_expr_range(&mut self, node: &'ast syn::ExprRange) {
        if let Some(end) = &node.end {
            // `..` and `..=` are of different types; one step of the end is the same mutant.
            let step = if matches!(node.limits, syn::RangeLimits::HalfOpen(_)) { "+" } else { "-" };
            self.add_expression(end, "range", format!("({}) {step} 1", self.text_of(end)));
        }
        visit::visit_expr_range(self, node);
    }

    fn visit_expr_lit(&mut self, node: &'ast syn::ExprLit) {
        if let Some(other) = other_literal(&node.lit) {
            self.add_expression(node, "literal", other);
        }
    }

    fn visit_expr_repeat(&mut self, node: &'ast syn::ExprRepeat) {
        self.visit_expr(&node.expr);
    }

    fn visit_expr_call(&mut self, node: &'ast syn::ExprCall) {
        if !self.text_of(&node.func).ends_with("with_capacity") {
            visit::visit_expr_call(self, node);
        }
    }

    fn visit_expr_method_call(&mut self, node: &'ast syn::ExprMethodCall) {
        self.visit_expr(&node.receiver);
        if !node.method.to_string().starts_with("reserve") {
            node.args.iter().for_each(|a| self.visit_expr(a));
        }
    }
}
