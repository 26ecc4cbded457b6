function import_module(name)
setenv('STUB_MODULE', name)
