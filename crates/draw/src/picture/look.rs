//! A look on data: which mode and attribute it comes to, and which transfer function.

use crate::color::transfer::TransferFunction;
use crate::look::LookPatch;
use crate::mode::Depiction;
use crate::modes;
use crate::store::Metadata;

/// A look's mode and attribute on some data.
///
/// # Errors
/// The names that the data has, when it has no such attribute.
pub fn depict(look: &LookPatch, metadata: &Metadata) -> Result<Depiction, String> {
    let fields = metadata.families.iter().flat_map(|family| &family.attributes).map(|field| field.name.as_str());
    let mode = look.mode.unwrap_or_else(|| modes::usual(fields));
    let depiction = Depiction::new(mode, look.settings.clone(), look.attribute_name(), metadata)?;
    let attribute = depiction.attribute.clone().filter(|_| !look.is_plain());
    Ok(Depiction { attribute, choice: look.budget.level_choice(), ..depiction })
}

/// The transfer function of a look: its own, or the usual one.
pub fn transfer_of(look: &LookPatch, depiction: &Depiction) -> TransferFunction {
    let painted = depiction.mode.is_light();
    let usual = || match painted {
        true => Some(TransferFunction::of_volumes(depiction.attribute.is_some())),
        false => TransferFunction::preset(depiction.mode.transfer[usize::from(depiction.attribute.is_some())]),
    };
    let own = look.transfer.clone().or_else(|| usual().map(|usual| depiction.suited(usual))).unwrap_or_default();
    if painted { own.for_volume() } else { own }
}
