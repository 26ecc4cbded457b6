"""For the tests of setid: cases that several of them share lie beside this file."""
