"""The gear model with stiff contact (Mason and Piiroinen 2009, equations 2.1 and 2.2)."""
